#!/usr/bin/env python3
"""Cycles that others measured on an STM32F407 and published, beside those that the virtual board estimates for the same code.

Needs git, cpp and Debian's binutils-arm-none-eabi; fetches the code of two repositories (none of it is kept here):
- Ko-/aes-armcortexm, "All the AES You Need on Cortex-M3 and M4" (Schwabe and Stoffelen, SAC 2016): no wait states;
- jnk0le/cortexm-AES, doc/aes/CM3_CM4_details.md: no and five wait states, with the flash's accelerator.

    python3 bench/peers/cycles.py [--folder FOLDER] [--page docs/bench.md]
"""
import argparse
import pathlib
import re
import subprocess
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
KO, JN = "Ko-/aes-armcortexm", "jnk0le/cortexm-AES"
# Flash: no wait states; five, with prefetch and both caches (FLASH_ACR).
FAST, SLOW = 0x000, 0x705
MARKS = ("<!-- cycles: begin -->", "<!-- cycles: end -->")

# Repository, source, function, published cycles, bytes that one call works on in blocks of 16 (0: a call is the unit), FLASH_ACR, fourth argument.
ROWS = [
    (KO, "aes128/aes.s", "AES_128_keyschedule", 244.9, 0, FAST, 0),
    (KO, "aes128/aes.s", "AES_128_encrypt", 634.7, 0, FAST, 0),
    (KO, "aes128ctr/aes_128_ctr.s", "AES_128_encrypt_ctr", 527.9, 4096, FAST, 4096),
    (KO, "aes192ctr/aes_192_ctr.s", "AES_192_keyschedule", 232.2, 0, FAST, 0),
    (KO, "aes192ctr/aes_192_ctr.s", "AES_192_encrypt_ctr", 644.0, 4096, FAST, 4096),
    (KO, "aes256ctr/aes_256_ctr.s", "AES_256_keyschedule", 309.9, 0, FAST, 0),
    (KO, "aes256ctr/aes_256_ctr.s", "AES_256_encrypt_ctr", 760.7, 4096, FAST, 4096),
    (KO, "aes128ctrbs/aes_128_ctr_bs.s", "AES_128_keyschedule", 1021.9, 0, FAST, 0),
    (KO, "aes128ctrbs/aes_128_ctr_bs.s", "AES_128_encrypt_ctr", 1616.6, 4096, FAST, 4096),
] + [
    (JN, f"aes/target/CM3_1T/{file}.S", file, published, 0, flash, rounds)
    for file, both, rounds in [
        ("CM3_1T_AES128_keyschedule_enc", (302, 302), 10),
        ("CM3_1T_AES256_keyschedule_enc", (378, 378), 14),
        ("CM3_1T_AES_encrypt", (626, 626), 10),
        ("CM3_1T_AES_encrypt", (858, 858), 14),
        ("CM3_1T_AES_decrypt", (629, 629), 10),
        ("CM3_1T_AES_decrypt", (863, 863), 14),
        ("CM3_1T_AES128_encrypt_unrolled", (601, 715), 10),
        ("CM3_1T_AES256_encrypt_unrolled", (821, 975), 14),
        ("CM3_1T_AES128_decrypt_unrolled", (602, 716), 10),
        ("CM3_1T_AES256_decrypt_unrolled", (822, 978), 14),
    ]
    for published, flash in zip(both, (FAST, SLOW))
]

# Tables lie in RAM, as the measurements had them; what they hold changes no time.
TABLES = {"AES_Te2": 0x20004000, "AES_Td2": 0x20005000, "AES_inv_sbox": 0x20006000, "AES_sBox": 0x20006000}

MAIN = """
.syntax unified
.cpu cortex-m4
.thumb
.section .vectors,"a"
.word 0x20018000
.word begin+1
.section .text
.global begin
.type begin,%function
.thumb_func
begin:
  ldr r0,=0x40023C00
  ldr r1,={flash}
  str r1,[r0]
  movs r7,#20
again:
  ldr r0,=0x20000100
  ldr r1,=0x20001000
  ldr r2,=0x20002800
  ldr r3,={argument}
  bl {function}
  subs r7,#1
  bne again
stop:
  b stop
.ltorg
"""

LINK = """
MEMORY { F : ORIGIN = 0x08000000, LENGTH = 512K }
ENTRY(begin)
SECTIONS { .v : { KEEP(*(.vectors)) } > F  .text : { *(.text*) *(.rodata*) *(.data*) } > F }
"""


def run(*command, **options):
    return subprocess.run([str(c) for c in command], check=True, capture_output=True, text=True, **options).stdout


def estimate(folder, program, row):
    repository, source, function, _, _, flash, argument = row
    source = folder / repository.replace("/", "+") / source
    (folder / "main.s").write_text(MAIN.format(flash=flash, argument=argument, function=function))
    (folder / "l.ld").write_text(LINK)
    code = source
    if source.suffix == ".S":
        code = folder / "code.s"
        code.write_text(run("cpp", "-P", "-D__ARM_EABI__", "-D__thumb2__", f"-I{folder / repository.replace('/', '+')}", source))
    objects = []
    for k, s in enumerate((folder / "main.s", code)):
        objects.append(folder / f"{k}.o")
        run("arm-none-eabi-as", "-mcpu=cortex-m4", "-mthumb", s, "-o", objects[-1])
    tables = [word for name, at in TABLES.items() for word in ("--defsym", f"{name}={at:#x}")] if repository == JN else []
    run("arm-none-eabi-ld", "-T", folder / "l.ld", *tables, *objects, "-o", folder / "a.elf")
    instructions, cycles = run(program, folder / "a.elf", function).split()
    return float(instructions), float(cycles)


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--folder", type=pathlib.Path, help="where the repositories are, or are cloned to")
    arguments.add_argument("--page", type=pathlib.Path, help="page whose table is written anew")
    arguments = arguments.parse_args()
    folder = (arguments.folder or pathlib.Path(tempfile.mkdtemp())).resolve()
    for repository in (KO, JN):
        here = folder / repository.replace("/", "+")
        if not here.exists():
            run("git", "clone", "--depth=1", f"https://github.com/{repository}", here)
    run("cargo", "build", "--release", "--locked", "-p", "virtual-board", "--example", "cycles", cwd=ROOT)
    program = ROOT / "target/release/examples/cycles"
    lines = ["| code | wait states | instructions | cycles, theirs, measured | ours, estimated | ratio |", "|---|---:|---:|---:|---:|---:|"]
    ratios = []
    for row in ROWS:
        repository, source, function, published, length, flash, argument = row
        blocks = length / 16 or 1
        instructions, cycles = (n / blocks for n in estimate(folder, program, row))
        ratios.append(cycles / published)
        name = f"{function} ({pathlib.Path(source).stem})" if repository == KO else f"{function}, {argument} rounds"
        lines.append(f"| `{name}` | {flash & 15} | {instructions:.1f} | {published} | {cycles:.1f} | {ratios[-1]:.3f} |")
    lines.append("")
    lines.append(f"{len(ratios)} figures: the estimate is {100 * (min(ratios) - 1):+.1f} to {100 * (max(ratios) - 1):+.1f} % of the measurement away.")
    text = "\n".join(lines) + "\n"
    print(text)
    if arguments.page:
        page = arguments.page.read_text()
        page = re.sub(f"{MARKS[0]}.*{MARKS[1]}", lambda _: f"{MARKS[0]}\n{text}{MARKS[1]}", page, flags=re.S)
        arguments.page.write_text(page)


if __name__ == "__main__":
    main()
