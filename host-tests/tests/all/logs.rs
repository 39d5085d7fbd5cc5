//! Sample logs of other programs, against the figures of those programs' own readers.

use hrg_data::recording::import;
use hrg_data::recording::import::map::Map;
use hrg_data::recording::Recording;
use std::path::PathBuf;

const DPH: f64 = 206_264.806_247;

fn read(name: &str, imu: u8) -> Recording {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("recordings/logs").join(name);
    let known = import::built_in(&path).expect("known by its beginning");
    let mut map = Map::built_in(known).expect("there");
    map.table.instance = imu;
    import::read(&path, &map).expect("reads")
}

/// By pyulog 1.3.0: `ULog("px4.ulg").data_list`, `sensor_gyro`: first and mean rate x (rad/s), first and mean temperature (C).
#[test]
fn px4_as_pyulog() {
    let of_pyulog = [
        (-0.041_303_209_96, -0.043_131_779_26, 40.025_371_55, 40.193_099_98),
        (0.017_656_758_43, 0.017_374_660_77, 28.246_023_18, 28.337_640_44),
        (-0.003_905_969_67, -0.006_826_704_51, 29.626_111_98, 29.626_112_62),
    ];
    for (imu, (first, mean, first_c, mean_c)) in of_pyulog.into_iter().enumerate() {
        let r = read("px4.ulg", imu as u8);
        let average = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
        assert_eq!(r.time_s.len(), 6);
        assert!((r.rate_dph[0][0] / DPH - first).abs() < 1e-9 && (average(&r.rate_dph[0]) / DPH - mean).abs() < 1e-9);
        assert!((r.frequency_hz[0][0] - first_c).abs() < 1e-5 && (average(&r.frequency_hz[0]) - mean_c).abs() < 2e-5);
        assert!(r.notes.iter().any(|n| n.starts_with(&format!("IMU {imu} is taken"))), "{:?}", r.notes);
    }
}

#[test]
fn betaflight() {
    let r = read("betaflight.bbl", 0);
    assert_eq!((r.time_s.len(), r.time_s[0]), (5, 33.011_567));
    assert!((r.rate_dph[1][0] - 3600.0).abs() < 1e-3 && r.rate_dph[0][0] == 0.0, "one degree a second about y");
}
