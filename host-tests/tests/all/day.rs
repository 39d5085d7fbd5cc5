//! The documented day through the real link: the program `hrg` against the virtual board, from a fresh unit on.

use host_tests::program;
use hrg::unit::record::{Recorder, Second};
use hrg_board::replay::{self, Options};
use hrg_board::serve;
use hrg_board::wires::{AxisFault, WireFaults};
use hrg_core::calibration::{Calibration, EffectTerm};
use hrg_core::effects::EffectId;
use hrg_core::status::AxisStatus;
use hrg_data::recording::steps::Steps;
use hrg_data::recording::Recording;
use hrg_identify::fit;
use hrg_identify::fit::correct;
use hrg_papers::method::Method;
use hrg_papers::methods;
use hrg_simulate::{Plan, Profile};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::OnceLock;
use std::time::Duration;

fn elf() -> Vec<u8> {
    replay::read_elf(&replay::default_elf()).expect("cargo xtask test builds the firmware first")
}

pub fn folder(name: &str) -> PathBuf {
    let p = std::env::temp_dir().join(format!("hrg-host-day-{}-{name}", std::process::id()));
    let _ = std::fs::remove_dir_all(&p);
    std::fs::create_dir_all(&p).expect("a temporary folder");
    p
}

pub fn command(folder: &Path, arguments: &str) -> Command {
    static ONCE: OnceLock<PathBuf> = OnceLock::new();
    let mut c = Command::new(ONCE.get_or_init(|| program("hrg")));
    // (An underscore stands for a blank.)
    c.current_dir(folder).args(arguments.split_whitespace().map(|a| a.replace('_', " "))).stdin(Stdio::null());
    c
}

fn hrg(folder: &Path, arguments: &str) -> Output {
    command(folder, arguments).output().expect("hrg runs")
}

/// Output of a command that must succeed.
fn ok(folder: &Path, arguments: &str) -> String {
    let o = hrg(folder, arguments);
    assert!(o.status.success(), "{arguments}: {}", String::from_utf8_lossy(&o.stderr));
    format!("{}{}", String::from_utf8_lossy(&o.stdout), String::from_utf8_lossy(&o.stderr))
}

/// Exit status 2, and the last line on standard error.
fn refused(folder: &Path, arguments: &str) -> String {
    let o = hrg(folder, arguments);
    let error = String::from_utf8_lossy(&o.stderr).into_owned();
    assert_eq!(o.status.code(), Some(2), "{arguments}: {error}");
    error.lines().last().unwrap_or("").to_string()
}

fn text(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join(name)).expect("written")
}

/// Temperature of the resonators of [`steps`] in a second, over the middle of their range, C.
pub fn warmer_c(second: usize) -> f64 {
    let at = second % 240;
    0.2 * at.min(240 - at) as f64 - 12.0
}

/// Minutes in which the resonators are warmed by 24 C and cooled again, fast enough for a test: 12 C per minute.
pub fn steps(minutes: u32, slope_dph_per_c: f64) -> Steps {
    let plan = Plan::of(Profile::parse(&format!("20,{minutes}m")).expect("fine"), 5, 3);
    let mut recording = plan.simulate().recording;
    recording.restore_earth_rate();
    let mut steps = Steps::new(&recording).expect("long enough");
    for (a, curve) in Calibration::uncalibrated().axes.map(|a| a.curve).iter().enumerate() {
        for (k, f) in steps.frequency_hz[a].iter_mut().enumerate() {
            steps.rate_dph[a][k] += slope_dph_per_c * warmer_c(k);
            *f = curve.frequency_hz(17.0 + warmer_c(k)).expect("in range") + 1e-4 * ((k * 7919) % 11) as f64;
        }
    }
    steps
}

/// Runs the board while something is done, half an hour of its time at most; its flash stays in the folder.
fn power(folder: &Path, speed: f64, work: impl FnOnce()) {
    power_for(&steps(29, 0.0), folder, speed, work);
}

/// The same with what the board lives through.
pub fn power_for(steps: &Steps, folder: &Path, speed: f64, work: impl FnOnce()) {
    let elf = elf();
    // Built before the board's time runs.
    let _ = command(folder, "");
    let options = serve::Options { speed, seconds: None, folder: folder.to_path_buf(), as_on_chip: false };
    let stop = AtomicBool::new(false);
    std::thread::scope(|s| {
        let board = s.spawn(|| serve::serve(&elf, None, steps, &options, &stop));
        while !folder.join("link").exists() {
            assert!(!board.is_finished(), "the board runs");
            std::thread::sleep(Duration::from_millis(20));
        }
        // Whatever fails in there: the board ends.
        let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(work));
        stop.store(true, Ordering::Relaxed);
        board.join().expect("no panic").expect("the board runs");
        result.unwrap_or_else(|e| std::panic::resume_unwind(e));
    });
}

/// Repeats the rows of a recording twelve times, one after the other: a fit asks for twenty means of 100 s.
fn lengthen(folder: &Path, name: &str) {
    let text = text(folder, name);
    let (head, rows): (Vec<&str>, Vec<&str>) = text.lines().partition(|l| !l.starts_with(|c: char| c.is_ascii_digit()));
    let time = |row: &str| row.split_once(',').and_then(|(t, _)| t.parse::<f64>().ok()).expect("a time");
    let length = time(rows[rows.len() - 1]) - time(rows[0]) + 1.0;
    let mut out = head.join("\n");
    for k in 0..12 {
        for row in &rows {
            let (_, rest) = row.split_once(',').expect("columns");
            out += &format!("\n{},{rest}", time(row) + length * f64::from(k));
        }
    }
    std::fs::write(folder.join(name), out + "\n").expect("written");
}

#[test]
fn from_a_fresh_unit_to_a_named_one_that_takes_no_other_calibration() {
    let d = folder("names");
    let place = "--latitude 28.2 --axes x=north_y=east_z=down";
    power(&d, 30.0, || {
        // A fresh unit has no name: what is recorded has the one that is given, or none.
        let printed = ok(&d, "record --port link --seconds 2 --out nameless.csv");
        assert!(printed.contains("no name yet") && printed.contains("without --latitude"), "{printed}");
        assert!(text(&d, "nameless.csv").contains("# unit: unnamed\n"));
        assert!(refused(&d, "record --port link --unit HRG_042 --seconds 2 --out no.csv").contains("no blanks"));
        ok(&d, &format!("record --port link --unit HRG-042 {place} --seconds 200 --out a.csv"));
        lengthen(&d, "a.csv");
        let head = text(&d, "a.csv");
        for line in [
            "# unit: HRG-042",
            "# latitude_deg: 28.2",
            "# axes: x=north y=east z=down",
            "# scale_factor_dph_per_code: 0.008583069 0.008583069 0.008583069",
            "# power_on_unix_s: ",
        ] {
            assert!(head.contains(line), "{line}");
        }
        let printed = ok(&d, "fit a.csv --out cal.toml");
        for wrong in ["earth's rate", "scale factor", "names no unit"] {
            assert!(!printed.contains(wrong), "{printed}");
        }
        // No user at the keyboard: the user's word is asked for.
        let e = refused(&d, "burn cal.toml --port link");
        assert!(e.contains("has no name yet") && e.contains("--unit HRG-042"), "{e}");
        assert!(refused(&d, "burn cal.toml --port link --unit HRG-7").contains("HRG-042"));
        ok(&d, "fit a.csv --out b.toml");
        let printed = ok(&d, "burn cal.toml --port link --unit HRG-042");
        assert!(printed.starts_with("HRG-042: burnt") && printed.contains("0.008583069"), "{printed}");
    });
    // The name stays when the power goes.
    power(&d, 30.0, || {
        ok(&d, &format!("record --port link {place} --seconds 200 --out again.csv"));
        lengthen(&d, "again.csv");
        let again = text(&d, "again.csv");
        assert!(again.contains("# unit: HRG-042\n") && !again.contains("# calibration: 00000000"));
        let e = refused(&d, "record --port link --unit HRG-7 --seconds 2 --out no.csv");
        assert!(e.contains("the unit is HRG-042, --unit says HRG-7"), "{e}");
        assert!(!d.join("no.csv").exists());
        ok(&d, "record --port link --unit HRG-042 --seconds 2 --out same.csv");
        // Another unit's image, and one of no unit.
        std::fs::write(d.join("nameless.csv"), text(&d, "a.csv").replace("# unit: HRG-042\n", "")).expect("written");
        std::fs::write(d.join("other.csv"), text(&d, "a.csv").replace("HRG-042", "HRG-9")).expect("written");
        ok(&d, "fit other.csv --out other.toml");
        ok(&d, "fit nameless.csv --out nameless.toml");
        let e = refused(&d, "burn other.toml --port link");
        assert!(e.contains("HRG-9") && e.contains("HRG-042") && e.contains("nothing was written"), "{e}");
        assert!(refused(&d, "burn other.toml --port link --unit HRG-042").contains("nothing was written"));
        let e = refused(&d, "burn nameless.toml --port link");
        assert!(e.contains("names no unit") && e.contains("--unit HRG-042"), "{e}");
        ok(&d, "burn nameless.toml --port link --unit HRG-042");
        // The scale factor is the unit's: a fit keeps it, and an image of another one is refused.
        ok(&d, "fit a.csv --scale-factor 0.01,0.01,0.01 --out scaled.toml");
        let e = refused(&d, "burn scaled.toml --port link");
        assert!(e.contains("0.008583069") && e.contains("0.01 0.01 0.01") && e.contains("--new-scale-factor"), "{e}");
        let printed = ok(&d, "burn scaled.toml --port link --new-scale-factor");
        assert!(printed.contains("number 3") && printed.contains("0.01 0.01 0.01"), "{printed}");
        ok(&d, &format!("record --port link {place} --seconds 200 --out scaled.csv"));
        lengthen(&d, "scaled.csv");
        assert!(text(&d, "scaled.csv").contains("# scale_factor_dph_per_code: 0.01 0.01 0.01\n"));
        ok(&d, "fit scaled.csv --out kept.toml");
        assert!(refused(&d, "correct scaled.csv --calibration cal.toml --out no.csv").contains("scale factor"));
        ok(&d, "correct scaled.csv --calibration kept.toml --out corrected.csv");
        assert!(ok(&d, "burn kept.toml --port link").contains("number 4"));
        assert!(refused(&d, "burn cal.toml --port link").contains("nothing was written"));
        assert!(refused(&d, "record --port link --scale-factor 1,1,1 --out no.csv").contains("0.01 0.01 0.01"));
    });
}

/// `hrg-board serve` as a user starts it.
struct Board(Child);

impl Board {
    fn on(folder: &Path, speed: &str) -> Self {
        let board = Command::new(program("hrg-board"))
            .current_dir(folder)
            .args(["serve", "--folder", ".", "--speed", speed])
            .stdout(Stdio::null())
            .spawn()
            .expect("hrg-board runs");
        let board = Self(board);
        while !folder.join("link").exists() {
            std::thread::sleep(Duration::from_millis(20));
        }
        board
    }

    /// Ctrl-C.
    fn off(mut self) {
        let pid = self.0.id().to_string();
        assert!(Command::new("kill").args(["-INT", &pid]).status().expect("kill runs").success());
        assert!(self.0.wait().expect("ends").success());
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_burn_that_fails_says_what_the_unit_holds() {
    let d = folder("burn");
    let mut c = Calibration::uncalibrated();
    c.set_unit_name("HRG-7");
    c.calibrated = true;
    c.axes.iter_mut().for_each(|a| a.coefficients = hrg_core::bias::Coefficients::One([1.0; 6]));
    let save = |name: &str, c: &Calibration| hrg_data::image_file::save(&d.join(name), c).expect("written");
    save("one.toml", &c);
    c.axes[0].coefficients = hrg_core::bias::Coefficients::One([2.0; 6]);
    save("two.toml", &c);
    // Slow enough to be cut while the image is written.
    let speed = "0.5";
    let _ = command(&d, "");
    let board = Board::on(&d, "2");
    ok(&d, "burn one.toml --port link --unit HRG-7");
    board.off();
    // (A busy machine may be done before it is cut: then once more.)
    let mut cut = 0;
    const TRIALS: usize = 10;
    for _ in 0..TRIALS {
        let board = Board::on(&d, speed);
        let burning = command(&d, "burn two.toml --port link").stderr(Stdio::piped()).stdout(Stdio::null()).spawn();
        let mut burning = burning.expect("hrg runs");
        let mut lines = BufReader::new(burning.stderr.take().expect("piped")).lines();
        let begun = lines.by_ref().map_while(Result::ok).any(|line| line.contains("is being written"));
        board.off();
        let board = Board::on(&d, "2");
        let printed = lines.map_while(Result::ok).collect::<Vec<_>>().join("\n");
        let ended = burning.wait().expect("ends");
        let running = ok(&d, "read --port link");
        board.off();
        assert!(begun, "{printed}");
        if ended.success() || !printed.contains("; asked now, ") {
            continue;
        }
        let after = |word: &str| -> String {
            running.split(word).nth(1).unwrap_or("").chars().take_while(|c| c.is_alphanumeric()).collect()
        };
        let (image, number) = (after("running image "), after(", number "));
        let wanted = format!("asked now, unit HRG-7 runs image {image}, number {number}; ");
        assert!(printed.contains("the port is gone") && printed.contains(&wanted), "{printed} - {running}");
        let then = printed.contains("a restart changes nothing") || printed.contains("from its next start on");
        assert!(then, "{printed}");
        cut += 1;
        break;
    }
    assert_eq!(cut, 1, "no burn was cut in {TRIALS}");
}

#[test]
fn sensors_beside_the_unit_are_recorded() {
    let d = folder("sensors");
    std::fs::write(d.join("sensors.txt"), "case_x_c=99\n").expect("written");
    power(&d, 10.0, || {
        let recording =
            command(&d, "record --port link --unit A --case-sensors sensors.txt --seconds 60 --out run.csv")
                .stdout(Stdio::piped())
                .spawn()
                .expect("hrg runs");
        use std::io::Write;
        while !d.join("run.csv").exists() {
            std::thread::sleep(Duration::from_millis(20));
        }
        let mut file = std::fs::File::options().append(true).open(d.join("sensors.txt")).expect("there");
        for k in 0..14 {
            std::thread::sleep(Duration::from_millis(300));
            writeln!(file, "case_x_c={}.25 case_y_c=21 chamber_c=25.5", 20 + k).expect("written");
        }
        writeln!(file, "humid").expect("written");
        let o = recording.wait_with_output().expect("ends");
        let printed = String::from_utf8_lossy(&o.stdout).into_owned();
        assert!(o.status.success() && printed.contains("sensors: ") && printed.contains("rows"), "{printed}");
        let e = refused(&d, "record --port link --case-sensors nowhere.txt --out no.csv");
        assert!(e.contains("nowhere.txt") && !d.join("no.csv").exists(), "{e}");
    });
    let r = Recording::load(&d.join("run.csv")).expect("a recording");
    let column =
        |name: &str| r.column(name).expect("there").iter().copied().filter(|v| v.is_finite()).collect::<Vec<_>>();
    let x = column("case_x_c");
    assert!(x.len() >= 8 && x.windows(2).all(|w| w[1] > w[0]) && x.iter().all(|v| *v < 40.0), "{x:?}");
    assert!(column("case_y_c").iter().all(|v| *v == 21.0) && column("case_z_c").is_empty());
    assert_eq!(column("chamber_c").len(), x.len());
}

/// The desktop's correction beside the ELF's own run.
#[test]
fn what_the_desktop_corrects_is_what_the_unit_sent_to_the_last_bit() {
    let d = folder("correct");
    let recording = Plan::of(Profile::parse("20,40@5,2m,25@5,1m").expect("fine"), 11, 12).simulate().recording;
    let train = Plan::of(Profile::parse("cycle").expect("named"), 11, 13).simulate().recording;
    let prepared = fit::prepare(&[train]).expect("prepares");
    let mut c = methods::identify(&prepared, Method::Lsq, 1).expect("fits").calibration;
    for (name, parameters, gain) in
        [("thermal-lag", [900.0, 0.0], 0.3), ("hysteresis", [4.0, 0.0], 0.2), ("warm-up", [500.0, 0.0], 2.0)]
    {
        let mut term = EffectTerm::new(EffectId::by_name(name).expect("known").facts().id, parameters);
        term.gains.iter_mut().for_each(|g| g[0] = gain);
        c.effects.push(term).expect("room");
    }
    let steps = Steps::new(&recording).expect("long enough");
    // One resonator is silent for a while, one jumps: the unit's answers to both are in its biases and its status.
    let faults = WireFaults {
        axis: vec![(1, AxisFault::Stop, 100.0..130.0), (2, AxisFault::Jump(3.0), 200.0..203.0)],
        glitch: Some((0, 40e-6)),
        ..WireFaults::default()
    };
    let options = Options { faults, compare: true, ..Options::default() };
    let outcome = replay::run(&elf(), Some(&c), &steps, &options, |_| {}).expect("runs");
    assert_eq!(
        outcome.received.differing, 0,
        "the digital twin, which shares the model: {:?}",
        outcome.received.first_difference
    );
    // Its measurements, as hrg record writes them; read as hrg correct reads them.
    let mut recorder = Recorder::new(&d.join("seen.csv"), c.unit_name());
    recorder.head.scale_factor = Some(c.scale_factors_dph_per_code());
    outcome.received.housekeeping.iter().for_each(|h| recorder.push(&Second::from(h)).expect("written"));
    let seen = Recording::parse(text(&d, "seen.csv").as_bytes()).expect("readable");
    let corrected = correct::recording(&c, &seen).expect("corrects");
    assert!(corrected.notes.iter().all(|n| n.contains("values are missing")), "{:?}", corrected.notes);
    let unit = outcome.seconds_of_frames();
    assert!(unit.len() > 590 && unit.len() == corrected.seconds.len(), "{}", unit.len());
    let bits = |v: [f32; 3]| v.map(f32::to_bits);
    let (mut lost, mut worst) = (0, 0.0f64);
    for (k, (ours, theirs)) in corrected.seconds.iter().zip(&unit).enumerate() {
        let frames = theirs.frames_dph;
        let theirs = &theirs.unit;
        assert_eq!(ours.time_s, theirs.time_s);
        assert_eq!(bits(ours.bias_dph), bits(theirs.bias_dph), "bias of second {k}");
        assert_eq!(bits(ours.temperature_c), bits(theirs.temperature_c), "temperature of second {k}");
        assert_eq!(ours.status, theirs.status, "status of second {k}");
        assert_eq!(bits(ours.raw_dph), bits(theirs.raw_dph));
        assert_eq!(bits(ours.corrected_dph), bits(theirs.corrected_dph), "corrected rate of second {k}");
        lost += u32::from(theirs.status[1] & AxisStatus::FREQUENCY_LOST.bits() != 0);
        // The mean of the 200 Hz frames themselves: sums in single precision, and the frame at each end of a second may hold
        // four samples of a thousand that are of the second beside it.
        for a in 0..3 {
            let near = &steps.rate_dph[a][k.max(1) - 1..(k + 3).min(steps.len())];
            let range = near.iter().copied().fold(f64::MIN, f64::max) - near.iter().copied().fold(f64::MAX, f64::min);
            let bias = f64::from(unit[k.max(1) - 1].unit.bias_dph[a] - unit[k.max(2) - 2].unit.bias_dph[a]).abs();
            let off = (frames[a] - f64::from(ours.corrected_dph[a])).abs();
            // (Frames are of up to 55 ms before their samples.)
            worst = worst.max(if k > 1 { off - 6e-2 * (range + bias) } else { 0.0 });
        }
    }
    assert!(lost >= 30, "{lost} seconds without a frequency");
    assert!(worst < 1e-4, "frames and second differ by {worst} deg/h more than that");
    assert!(unit.iter().any(|s| s.unit.status[0] & AxisStatus::EDGE_ERRORS.bits() != 0), "an edge error is among them");
    // The file of hrg correct is, but for its title, that of hrg-board run.
    let board = replay::to_csv(&seen, Some(&c), &unit);
    let desktop = correct::to_csv(&seen, "through the ELF on the virtual board", 0.0, Some(&c), &corrected.seconds);
    assert!(board == desktop && board.lines().count() > 600);
}

#[test]
fn a_correction_that_is_off_by_a_second_or_a_bit_is_found() {
    // The comparison above can fail: the bias of the same second, and a coefficient in its last place.
    let steps = Steps::new(&Plan::of(Profile::parse("20,40@5,1m").expect("fine"), 11, 12).simulate().recording);
    let steps = steps.expect("long enough");
    let mut c = Calibration::uncalibrated();
    c.calibrated = true;
    c.axes.iter_mut().for_each(|a| a.coefficients = hrg_core::bias::Coefficients::One([1.0, 9.0, 0.0, 0.5, 0.0, 0.0]));
    let right = correct::correct(&c, &steps);
    assert!(right.iter().filter(|s| s.corrected_dph[0] != s.raw_dph[0] - s.bias_dph[0]).count() > 200);
    c.axes[0].coefficients =
        hrg_core::bias::Coefficients::One([1.0, f32::from_bits(9.0f32.to_bits() + 1), 0.0, 0.5, 0.0, 0.0]);
    assert!(correct::correct(&c, &steps).iter().zip(&right).any(|(a, b)| a.bias_dph != b.bias_dph));
}
