//! The parts of the plant behave as their physics says.

use foreign_plant::chamber::{Chamber, Program, Span};
use foreign_plant::draw::{stream, Design, Properties, Seed};
use foreign_plant::means::{deviation, means};
use foreign_plant::noise::{self, Mixture, Noise};
use foreign_plant::operators as op;
use foreign_plant::sensors::Curve;
use foreign_plant::series::{Selection, Series};
use foreign_plant::thermal::Network;
use rustfft::{num_complex::Complex, FftPlanner};

const SPAN: Span = Span { low_c: -42.0, high_c: 55.0, start_c: 22.0 };

fn powers(x: &[f64]) -> Vec<f64> {
    let mut spectrum: Vec<Complex<f64>> = x.iter().map(|&x| Complex::new(x, 0.0)).collect();
    FftPlanner::new().plan_fft_forward(x.len()).process(&mut spectrum);
    spectrum.iter().take(x.len() / 2).map(Complex::norm_sqr).collect()
}

#[test]
fn flicker_has_the_slope_that_is_asked_for() {
    for exponent in [0.8, 1.0, 1.4] {
        let mut slopes = Vec::new();
        for seed in 0..6 {
            let x = noise::correlated(&mut stream(seed, &["slope"]), 32_768, 1.0, |f| f.powf(-exponent));
            let p = powers(&x);
            // Mean power of octaves, away from both ends.
            let octaves: Vec<(f64, f64)> = (5..13)
                .map(|k| {
                    let (from, to) = (1 << k, 2 << k);
                    let mean = p[from..to].iter().sum::<f64>() / (to - from) as f64;
                    (f64::from(k), mean.log2())
                })
                .collect();
            let n = octaves.len() as f64;
            let (mx, my) = (octaves.iter().map(|o| o.0).sum::<f64>() / n, octaves.iter().map(|o| o.1).sum::<f64>() / n);
            let slope = octaves.iter().map(|o| (o.0 - mx) * (o.1 - my)).sum::<f64>()
                / octaves.iter().map(|o| (o.0 - mx).powi(2)).sum::<f64>();
            slopes.push(-slope);
        }
        let mean = slopes.iter().sum::<f64>() / slopes.len() as f64;
        assert!((mean - exponent).abs() < 0.1, "asked for {exponent}, got {mean}");
    }
}

#[test]
fn correlated_noise_deviates_by_one_in_100_s_means() {
    for exponent in [0.8, 1.4] {
        let squares = (0..100).map(|seed| {
            let x = noise::correlated(&mut stream(seed, &["scale"]), 6000, 1.0, |f| f.powf(-exponent));
            deviation(&means(&x, 1.0, 0)).powi(2)
        });
        let variance = squares.sum::<f64>() / 100.0;
        // 100 runs leave 5 % of scatter.
        assert!((variance - 1.0).abs() < 0.15, "exponent {exponent}: {variance}");
    }
}

#[test]
fn every_kind_of_noise_has_the_floor_that_is_asked_for() {
    let t_c: Vec<f64> = (0..25_200).map(|i| 10.0 + 48.0 * (f64::from(i) / 2400.0).sin()).collect();
    let kinds = [
        Noise::Usual,
        Noise::White,
        Noise::Flicker(1.4),
        Noise::Walk,
        Noise::Lines,
        Noise::GaussMarkov,
        Noise::GrowsWithTemperature,
        Noise::HeavyTails,
        Noise::Bursts,
    ];
    for kind in kinds {
        let squares: f64 = (0..20)
            .map(|seed| {
                let mut rng = stream(seed, &["floor"]);
                let mixture = Mixture::draw(&mut Properties::new(seed.into(), &["mixture"]), &kind);
                deviation(&means(&noise::sample(&mut rng, &kind, mixture, &t_c, 1.0), 1.0, 0)).powi(2)
            })
            .sum();
        let floor = (squares / 20.0).sqrt();
        assert!((0.85..1.15).contains(&floor), "{}: {floor}", kind.name());
    }
}

#[test]
fn a_surrogate_keeps_the_spectrum_and_nothing_else() {
    let measured = noise::correlated(&mut stream(1, &["measured"]), 4096, 1.0, |f| 1.0 / (f * f + 1e-5));
    let text: String = measured.iter().map(|x| format!("{x}\n")).collect();
    let selection = Selection { step_s: Some(1.0), ..Selection::default() };
    let series = Series::parse(&text, "m".into(), &selection).expect("a series");
    let a = series.surrogate(&mut stream(1, &["a"]), 0, 4096, 1.0);
    let b = series.surrogate(&mut stream(2, &["a"]), 0, 4096, 1.0);
    // The series has one row less than the surrogate: compare octaves, not lines.
    let (own, pa) = (powers(&series.columns[0]), powers(&a));
    for k in 2..11 {
        let sum = |p: &[f64]| p[1 << k..2 << k].iter().sum::<f64>();
        let ratio = sum(&pa) / sum(&own) / 4096.0 / 4096.0;
        assert!((0.7..1.4).contains(&ratio), "octave {k}: {ratio}");
    }
    let product: f64 = a.iter().zip(&b).map(|(a, b)| a * b).sum::<f64>() / 4096.0;
    assert!((product / deviation(&a) / deviation(&b)).abs() < 0.6, "two surrogates are two series");
}

#[test]
fn a_surrogate_longer_than_its_series_does_not_repeat() {
    let text: String =
        noise::correlated(&mut stream(3, &["m"]), 1000, 1.0, |f| 1.0 / f).iter().map(|x| format!("{x}\n")).collect();
    let selection = Selection { step_s: Some(1.0), ..Selection::default() };
    let series = Series::parse(&text, "m".into(), &selection).expect("a series");
    let x = series.surrogate(&mut stream(1, &["a"]), 0, 3000, 1.0);
    let again: f64 = (0..1000).map(|i| x[i] * x[i + 1000]).sum::<f64>() / 1000.0;
    assert!(again.abs() < 0.7 * deviation(&x).powi(2), "correlation after one length: {again}");
}

#[test]
fn tables_of_residuals_are_read_or_refused_with_a_sentence() {
    let header = "time\tgyro\ttemp\n";
    let rows: String = (0..400)
        .map(|i| format!("{i}\t{}\t{}\n", 3.0 * f64::from(i % 50) + (f64::from(i) * 0.9).sin(), i % 50))
        .collect();
    let selection =
        Selection { columns: vec!["gyro".into()], against: Some("temp".into()), skip: 2, ..Selection::default() };
    let series = Series::parse(&format!("{header}{rows}"), "t".into(), &selection).expect("a series");
    assert_eq!(series.columns[0].len(), 398);
    let refused = |text: &str, selection: &Selection| {
        format!("{:#}", Series::parse(text, "t".into(), selection).expect_err("refused"))
    };
    assert!(refused("a,b\n1,2\n", &Selection::default()).contains("256"));
    let other = Selection { columns: vec!["rate".into()], ..Selection::default() };
    assert_eq!(refused(&format!("{header}{rows}"), &other), "there is no column `rate`; there are: time, gyro, temp");
    let bad = "1,2\nx,y\nx,y\nx,y\nx,y\n1,2\n".repeat(100);
    assert!(refused(&bad, &Selection::default()).contains("line 2: `y` is not a number"));
    assert!(refused(&"1,2\n".repeat(300), &Selection::default()).contains("constant"));
    assert_eq!(refused("", &Selection::default()), "it holds no rows");
}

#[test]
fn frequency_curves_are_near_96_ppm_and_can_be_inverted() {
    for seed in 0..50 {
        for axis in 0..3 {
            let curve = Curve::draw(&mut Properties::new(seed.into(), &["curve"]), axis);
            let ppm = curve.hz_per_c(25.0) / curve.hz(25.0) * 1e6;
            assert!((90.0..102.0).contains(&ppm), "{ppm} ppm/C");
            for t in [-45.0, -3.0, 25.0, 64.0] {
                assert!((curve.t_c(curve.hz(t), 20.0) - t).abs() < 1e-6);
            }
        }
    }
}

#[test]
fn the_chamber_overshoots_ripples_and_follows_its_program() {
    let mut most_overshoot: f64 = 0.0;
    let mut rippling = 0;
    for seed in 0..10 {
        let chamber = Chamber::draw(&mut Properties::new(seed.into(), &["its numbers"]));
        // To 55 C at 1.5 C/min, an hour there; to -10 C, an hour there.
        let mut set = vec![22.0; 600];
        set.extend((0..1320).map(|i| 22.0 + f64::from(i) * 0.025));
        set.extend(vec![55.0; 3600]);
        set.extend((0..2600).map(|i| 55.0 - f64::from(i) * 0.025));
        set.extend(vec![-10.0; 3600]);
        let air = chamber.air(&set, 1.0);
        let overshoot = air[1920..5520].iter().fold(f64::MIN, |a, &b| a.max(b)) - 55.0;
        most_overshoot = most_overshoot.max(overshoot);
        assert!((0.2..4.0).contains(&overshoot), "overshoot {overshoot} C");
        assert!((air[5500] - 55.0).abs() < 0.3 && (air[11_700] + 10.0).abs() < 1.5, "settles");
        // Turning points of the air in the cold soak, in means of 20 s.
        let smooth: Vec<f64> = air[8600..11_600].chunks(20).map(|c| c.iter().sum::<f64>() / c.len() as f64).collect();
        let turns = smooth.windows(3).filter(|w| (w[1] - w[0]) * (w[2] - w[1]) < 0.0).count();
        rippling += usize::from(turns >= 6);
    }
    assert!(rippling >= 5, "the compressor ripples in {rippling} of 10 chambers");
}

#[test]
fn a_powered_unit_warms_itself_and_each_body_follows_at_its_own_pace() {
    for seed in 0..10 {
        let network = Network::draw(&mut Properties::new(seed.into(), &["network"]));
        let bodies = network.run(&vec![20.0; 4 * 3600], 1.0);
        for a in 0..3 {
            let end = bodies.resonator_c[a][4 * 3600 - 1];
            assert!((23.0..28.0).contains(&end), "self-heating to {end} C");
            assert!(bodies.resonator_c[a][1200] < end - 0.3, "it takes longer than 20 min");
        }
        assert!(bodies.board_c[4 * 3600 - 1] > bodies.base_c[4 * 3600 - 1] + 2.0, "the board is the source");
        // A step of air: the resonator is at 63 % after 10 to 25 min, case before it.
        let mut air = vec![0.0; 6 * 3600];
        air.extend(vec![10.0; 2 * 3600]);
        let bodies = network.run(&air, 1.0);
        let reached = |x: &[f64]| {
            let start = x[6 * 3600 - 1];
            let end = start + 10.0;
            (6 * 3600..x.len()).find(|&i| x[i] > start + 0.63 * (end - start)).map(|i| i - 6 * 3600)
        };
        let (case, resonator) =
            (reached(&bodies.case_c[0]).expect("rises"), reached(&bodies.resonator_c[0]).expect("rises"));
        assert!(case + 60 < resonator && (600..1800).contains(&resonator), "{case} s, {resonator} s");
    }
}

#[test]
fn programs_stay_in_their_span_and_go_both_ways_unless_they_say_otherwise() {
    use Program::*;
    for program in [
        Cycles,
        Stairs,
        TwoSpeed,
        SetpointWalk,
        ShrinkingLoops,
        SawSweep,
        Soaks,
        Gentle,
        Brisk,
        HeatingOnly,
        CoolingOnly,
    ] {
        for seed in 0..5 {
            let set = program.set_points(&mut stream(seed, &["program"]), SPAN, 1.0, 7.0 * 3600.0);
            assert_eq!(set.len(), 25_200);
            assert!(set.iter().all(|t| (-42.001..55.001).contains(t)), "{program:?}");
            let ramps = || set.windows(2).map(|w| (w[1] - w[0]) * 60.0);
            assert!(ramps().all(|r| r.abs() < 2.5), "{program:?}");
            let (up, down) = (ramps().any(|r| r > 0.2), ramps().any(|r| r < -0.2));
            assert!(up || program == CoolingOnly, "{program:?} heats");
            assert!(down || program == HeatingOnly, "{program:?} cools");
        }
    }
}

#[test]
fn operators_follow_their_laws() {
    let ramp: Vec<f64> = (0..4000).map(|i| f64::from(i) * 0.01).collect();
    // A lag follows a ramp by its time constant times the slope.
    let lagged = op::lag(&ramp, 1.0, 300.0, 0.0);
    assert!((ramp[3999] - lagged[3999] - 3.0).abs() < 0.02);
    // A rod's far end follows a ramp by half its diffusion time.
    let rod = op::rod_end(&ramp, 1.0, 1000.0, 0.0);
    assert!((ramp[3999] - rod[3999] - 5.0).abs() < 0.05, "{}", ramp[3999] - rod[3999]);
    // A play stands still over less than its width, and is dragged beyond.
    let up_and_down: Vec<f64> = (0..=200).map(|i| if i <= 100 { f64::from(i) } else { f64::from(200 - i) }).collect();
    let play = op::play(&up_and_down, 10.0, 0.0);
    assert_eq!((play[100], play[115], play[200]), (90.0, 90.0, 10.0));
    // A relay keeps its state between the thresholds.
    let relay = op::relay(&up_and_down, 30.0, 60.0, -1.0);
    assert_eq!((relay[59], relay[60], relay[165], relay[170]), (-1.0, 1.0, 1.0, -1.0));
    // A closed minor loop leaves no trace in Preisach's relays: return-point memory.
    let path = |inner: bool| -> Vec<f64> {
        let mut t: Vec<f64> = (0..=50).map(f64::from).collect();
        if inner {
            t.extend((30..50).rev().map(f64::from));
            t.extend((31..=50).map(f64::from));
        }
        t.extend((0..50).rev().map(f64::from));
        t
    };
    let end = |t: &[f64]| -> f64 {
        (0..40).map(|k| op::relay(t, f64::from(k), f64::from(k) + 7.0, -1.0)[t.len() - 11]).sum()
    };
    assert_eq!(end(&path(false)), end(&path(true)));
    // Bouc-Wen and Dahl stay within their limits, and open a loop.
    let swing: Vec<f64> = (0..4000).map(|i| 40.0 * (f64::from(i) * 0.005).sin()).collect();
    let bouc_wen = op::bouc_wen(&swing, 8.0, 1.5, 0.7, 0.0);
    assert!(bouc_wen.iter().all(|z| z.abs() < 8.5) && bouc_wen.iter().any(|z| z.abs() > 6.0));
    let dahl = op::dahl(&swing, 8.0, 0.0);
    assert!(dahl.iter().all(|f| f.abs() <= 1.0) && dahl.iter().any(|f| f.abs() > 0.8));
    // At the same temperature, rising and falling (a period is 1256.6 steps), the force differs.
    assert!((dahl[1257] - dahl[1885]).abs() > 0.5);
}

#[test]
fn units_of_a_design_have_its_properties_each_a_little_off() {
    let of = |unit: u64, design: u64| Seed { unit, design: Some(Design { seed: design, spread: 0.3 }) };
    let drawn = |seed: Seed| Properties::new(seed, &["a property"]).random_range(100.0..200.0);
    let one: Vec<f64> = (0..200).map(|unit| drawn(of(unit, 1))).collect();
    let (least, most) = one.iter().fold((f64::MAX, f64::MIN), |(l, m), v| (l.min(*v), m.max(*v)));
    // Within 15 either way of the design's, but not all alike.
    assert!((15.0..=30.0).contains(&(most - least)), "{least} to {most}");
    let designs: Vec<f64> = (0..200).map(|design| drawn(of(1, design))).collect();
    assert!(deviation(&designs) > 3.0 * deviation(&one), "{} and {}", deviation(&designs), deviation(&one));
    let sign = |seed: Seed| Properties::new(seed, &["a sign"]).random_bool(0.5);
    assert!((0..50).all(|unit| sign(of(unit, 1)) == sign(of(0, 1))));
}

#[test]
fn a_further_run_changes_nothing_else_and_follows_its_legs() {
    let case = foreign_plant::cases().into_iter().find(|c| c.name == "memory-rod").expect("the case is there");
    let mut further = foreign_plant::case::run(Program::Cycles, 2.0);
    further.plan.legs = &[foreign_plant::chamber::Leg { to_c: -30.0, c_per_min: 2.0, hold_min: 200.0 }];
    let with = foreign_plant::Case { more: vec![further], ..case.clone() };
    let (without, with) = (case.generate(1), with.generate(1));
    let rows = |r: &foreign_plant::Recording| r.columns.iter().map(|c| c.values.clone()).collect::<Vec<_>>();
    assert!(rows(&without.judge) == rows(&with.judge) && without.more.is_empty());
    let air = with.more[0].columns.iter().find(|c| c.name == "chamber_c").expect("recorded");
    assert!((air.values[air.values.len() - 1] + 30.0).abs() < 2.0, "{:?}", air.values.last());
}
