//! The figures of docs/papers.md, computed from what the papers print. Nothing here comes from our own code, save that the page is looked at.

const PAGE: &str = include_str!("../../../docs/papers.md");

/// A figure that the page must hold.
#[track_caller]
fn on_page(what: &str, figure: &str) {
    println!("{what}: {figure}");
    assert!(PAGE.contains(figure), "docs/papers.md lacks {figure} ({what})");
}

/// dong2023's Table 1, gyro x: frequency (Hz), chamber and case (C).
const TABLE_1: [(f64, f64, f64); 10] = [
    (4878.848, -40.0, -34.374),
    (4883.616, -30.0, -24.689),
    (4888.354, -20.0, -14.992),
    (4893.202, -10.0, -5.000),
    (4898.626, 0.0, 6.314),
    (4903.263, 10.0, 16.124),
    (4907.768, 20.0, 25.751),
    (4912.232, 30.0, 35.443),
    (4916.727, 40.0, 45.267),
    (4921.152, 50.0, 55.128),
];
const PRINTED_T3: [f64; 10] = [-34.367, -24.696, -15.005, -4.994, 6.330, 16.125, 25.754, 35.418, 45.279, 55.128];
const PRINTED_T4: [f64; 10] = [-34.390, -24.716, -15.025, -5.016, 6.306, 16.101, 25.732, 35.397, 45.259, 55.103];

/// Least squares of a polynomial about `centre`, scaled by 50: Gauss on the normal equations.
fn polynomial(x: &[f64], y: &[f64], degree: usize, centre: f64) -> Vec<f64> {
    let n = degree + 1;
    let mut a = vec![vec![0.0; n + 1]; n];
    for (x, y) in x.iter().zip(y) {
        let u = (x - centre) / 50.0;
        for i in 0..n {
            for j in 0..n {
                a[i][j] += u.powi((i + j) as i32);
            }
            a[i][n] += u.powi(i as i32) * y;
        }
    }
    for i in 0..n {
        let pivot = (i..n).max_by(|p, q| a[*p][i].abs().total_cmp(&a[*q][i].abs())).expect("rows");
        a.swap(i, pivot);
        for k in i + 1..n {
            let share = a[k][i] / a[i][i];
            for j in i..=n {
                a[k][j] -= share * a[i][j];
            }
        }
    }
    let mut c = vec![0.0; n];
    for i in (0..n).rev() {
        c[i] = (a[i][n] - (i + 1..n).map(|j| a[i][j] * c[j]).sum::<f64>()) / a[i][i];
    }
    c
}

fn value(c: &[f64], x: f64, centre: f64) -> f64 {
    c.iter().rev().fold(0.0, |sum, c| sum * ((x - centre) / 50.0) + c)
}

fn columns() -> (Vec<f64>, Vec<f64>, Vec<f64>) {
    let pick = |f: fn(&(f64, f64, f64)) -> f64| TABLE_1.iter().map(f).collect();
    (pick(|r| r.0), pick(|r| r.1), pick(|r| r.2))
}

#[test]
fn dong2023_curves() {
    let (f, chamber, case) = columns();
    let cubic = |t: &[f64]| polynomial(t, &f, 3, 0.0)[3] / 50f64.powi(3);
    on_page("eq 1 and 2, cubic terms refitted", &format!("{:.3e}, {:.3e}", cubic(&chamber), cubic(&case)));
    // T3: the root of the refitted cubic, by bisection.
    let c = polynomial(&case, &f, 3, 0.0);
    let root = |f: f64| {
        let (mut low, mut high) = (-100.0, 100.0);
        for _ in 0..100 {
            let middle = 0.5 * (low + high);
            if value(&c, middle, 0.0) < f {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    };
    let worst = f.iter().zip(PRINTED_T3).map(|(f, t)| (root(*f) - t).abs()).fold(0.0, f64::max);
    on_page("T3 of the refit against the printed one", &format!("{worst:.4} C"));
    // T4: the inverse cubic, centred.
    let inverse = polynomial(&f, &case, 3, 4900.0);
    let low: Vec<f64> = f.iter().zip(PRINTED_T4).map(|(f, t)| value(&inverse, *f, 4900.0) - t).collect();
    let (least, most) = low.iter().fold((f64::INFINITY, 0.0f64), |(a, b), v| (a.min(*v), b.max(*v)));
    on_page("T4, printed too low by", &format!("{least:.4} to {most:.4} C"));
    let printed = |f: f64| 1.792e-5 * f.powi(3) - 2.608e-1 * f * f + 1.267e3 * f - 2.056e6;
    on_page("T(f) with the printed coefficients", &format!("{:.0} C, where {} C", printed(f[4]), case[4]));
    let (t3_t4, t4_t2) = (PRINTED_T3[0] - PRINTED_T4[0], PRINTED_T4[0] - case[0]);
    on_page("Table 2, first row", &format!("{t3_t4:.3} and {t4_t2:.3}"));
    // Fig 4: the slope of eq 2 as printed is positive from -100 to 100 C.
    assert!((-100..=100).all(|t| 3.0 * -5.751e-7 * f64::from(t * t) - 2.0 * 2.568e-4 * f64::from(t) + 4.794e-1 > 0.4));
    // zhao2022's linear curve on the same table, and the slope.
    let line = polynomial(&f, &case, 1, 4900.0);
    let worst = |c: &[f64]| f.iter().zip(&case).map(|(f, t)| (value(c, *f, 4900.0) - t).abs()).fold(0.0, f64::max);
    on_page("a line, a cubic", &format!("{:.2} C, a cubic by {:.3} C", worst(&line), worst(&inverse)));
    let ppm = 1e6 * 50.0 / line[1] / 4900.0;
    on_page("slope", &format!("{ppm:.0} ppm"));
    on_page("kE", &format!("{:.1e}", 2e-6 * ppm));
}

#[test]
fn dong2023_tables() {
    let better = |raw: f64, after: f64| 100.0 * (1.0 - after / raw);
    let (cooling, heating) = ((7.071, 3.812, 3.753), (9.512, 5.096, 5.022));
    on_page(
        "Table 4, swarm",
        &format!("{:.1} % cooling and {:.1} % heating", better(cooling.0, cooling.1), better(heating.0, heating.1)),
    );
    on_page(
        "Table 4, least squares",
        &format!("{:.1} % and {:.1} %", better(cooling.0, cooling.2), better(heating.0, heating.2)),
    );
    on_page(
        "swarm above least squares",
        &format!("{:.1} % and {:.1} % above", 100.0 * (3.812 / 3.753 - 1.0), 100.0 * (5.096 / 5.022 - 1.0)),
    );
    let at = |k: [f64; 3], t: f64| k[0] + k[1] * t + k[2] * t * t;
    let step = at([2.405e-2, 2.888e-5, -8.602e-7], -40.0) - at([2.226e-2, -2.376e-5, -1.751e-6], -40.0);
    on_page("Table 3, step at -40 C", &format!("{step:.4}"));
    on_page("in deg/h if in deg/s", &format!("{:.1} deg/h", 3600.0 * step));
}

#[test]
fn wu2023_and_zhao2022() {
    let better = |after: f64| 100.0 * (1.0 - after / 0.015_628);
    on_page(
        "J1, J2, burnt",
        &format!("{:.1} %, {:.1} % and {:.1} %", better(0.007_286), better(0.006_117), better(0.006_948)),
    );
    on_page("jump at the breakpoint", &format!("{:.2} units", 5.8191 + 2.9505));
    // zhao2022: the bias follows a ramp of 5 C/min over 60 C through a lag of 694 s, and then stands: 112 min in all.
    let (mut chamber, mut resonator) = (0.0f64, 0.0f64);
    let bias: Vec<f64> = (0..112 * 60)
        .map(|_| {
            chamber = (chamber + 5.0 / 60.0).min(60.0);
            resonator += (chamber - resonator) / 694.0;
            -2.4497 + (-11.0213 + 2.4497) * resonator / 60.0
        })
        .collect();
    let mean = bias.iter().sum::<f64>() / bias.len() as f64;
    let sigma = (bias.iter().map(|b| (b - mean).powi(2)).sum::<f64>() / bias.len() as f64).sqrt();
    on_page("standard deviation from the ramp's start", &format!("{sigma:.1} deg/h"));
}

#[test]
fn chen2015_errata() {
    let (dph, earth) = (std::f64::consts::PI / 180.0 / 3600.0, 7.292_115e-5);
    let latitude = 45f64.to_radians();
    let (oc, os) = (earth * latitude.cos(), earth * latitude.sin());
    let a = 100f64.to_radians();
    on_page("theta_A for its sine", &format!("{:.1} degrees", a.sin().to_degrees()));
    on_page("cos theta_A left out", &format!("{:.1} deg/h", oc * (1.0 - a.cos()) / dph));
    let (g, t, tilt) = (9.7966, 200.0, 3.0 / 60.0 * std::f64::consts::PI / 180.0);
    on_page("sign of theta_N0 in eq 12", &format!("{:.1} m/s", 2.0 * g * tilt * t));
    // The drift that the other axis has: the earth's rate along it, at the paper's azimuth.
    let apparent = oc * a.sin();
    let power = g * apparent / 6.0 * (os * t.powi(3) - (os * t).powi(3));
    on_page("the power in eq 12 and 13", &format!("{:.0} mm/s", 1000.0 * power));
    // One position: the drift about east over the horizontal earth rate.
    let arcmin = |drift_dph: f64| (drift_dph * dph / oc).to_degrees() * 60.0;
    let east = 0.2 * a.sin() + 0.1 * a.cos();
    on_page("one position", &format!("{:.0}'", arcmin(east)));
    let needed = |arcmin: f64| (arcmin / 60.0).to_radians() * oc / dph;
    on_page("4' and 7'", &format!("{:.3} deg/h, 7' to {:.3} deg/h", needed(4.0), needed(7.0)));
}
