use hrg_board::{faults::Scene, replay};
fn main() {
    let elf = replay::read_elf(&replay::default_elf()).unwrap();
    let scene = Scene::new(&elf, 1).unwrap();
    let mut b = scene.off(scene.wires(), &scene.calibration).unwrap();
    b.run_until(30 * virtual_board::CPU_HZ).unwrap();
    b.start_profile();
    b.run_until(40 * virtual_board::CPU_HZ).unwrap();
    for (n, c) in b.profile(&elf).unwrap().into_iter().take(45) {
        println!("{:>9.0} {:#}", c as f64 / 10.0, rustc_demangle::demangle(&n));
    }
}
