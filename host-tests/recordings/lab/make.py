"""Makes the lab's files from simulated runs, as a German LabVIEW and a temperature logger write them: Latin-1, semicolons, decimal commas,
dates, a title before the header, texts for missing values, a logger whose clock is 37 s ahead. Simulated (hrg simulate, unit 3, a kink of
four floors). Needs numpy, pandas and openpyxl: python3 make.py path/to/hrg
"""

import datetime as dt
import gzip
import subprocess
import sys

import numpy as np
import pandas as pd

STEP_S = 10


def number(value, digits):
    return f"{value:.{digits}f}".replace(".", ",")


def write(name, lines):
    with gzip.GzipFile(name, "wb", mtime=0) as f:
        f.write("".join(line + "\r\n" for line in lines).encode("latin-1"))


for seed, profile, k, day in ((5, "cycle", 1, 20), (6, "verify", 2, 21)):
    simulate = ["simulate", "--profile", profile, "--unit", "3", "--seed", str(seed), "--effect", "kink:size=4"]
    subprocess.run([sys.argv[1], *simulate, "--thermometer", "sensor", "--out", "run.csv"], check=True)
    run = pd.read_csv("run.csv", comment="#")
    start = dt.datetime(2026, 11, day, 7, 30)
    means = run.groupby(np.arange(len(run)) // STEP_S).mean()
    temperature = run.filter(regex="^temp").mean(axis=1)
    rows = ["Prüfling: FOG-3-0815", "Messung Kammer 7", "", "Zeit;Kreisel X [°/s];Kreisel Y [°/s];Kreisel Z [°/s];Status"]
    for row, mean in means.iterrows():
        time = start + dt.timedelta(seconds=STEP_S * (row + 1))
        rates = ["---" if (row + 1) % 397 == 0 else number(mean[f"rate_{a}_dph"] / 3600, 8) for a in "xyz"]
        rows.append(f"{time:%d.%m.%Y %H:%M:%S},0;{';'.join(rates)};OK")
    write(f"lauf{k}.csv.gz", rows)
    log = ["Datum;Uhrzeit;Pt100 [°C]"]
    for s in range(0, len(run), 15):
        time = start + dt.timedelta(seconds=s + 37)
        log.append(f"{time:%d.%m.%Y};{time:%H:%M:%S};{'#NV' if s % 3000 == 1500 else number(temperature[s], 2)}")
    write(f"pt100_{k}.csv.gz", log)
    if k == 1:
        sheet = pd.DataFrame({"Time": [start + dt.timedelta(seconds=STEP_S * n) for n in range(60)]})
        for a in "xyz":
            sheet[f"Gyro {a.upper()} [deg/h]"] = means[f"rate_{a}_dph"][:60].to_numpy()
        sheet["Temperature [°C]"] = temperature[: 60 * STEP_S : STEP_S].to_numpy()
        sheet.to_excel("lab.xlsx", index=False, startrow=2)
