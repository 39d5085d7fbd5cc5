//! The written image on the third run of a unit, which chose nothing: its bias by `hrg correct` against the true one.

use anyhow::{bail, Context, Result};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// Duration of a mean, s.
const MEAN_S: f64 = 100.0;
/// Status bits that do not say that a bias is beyond what was calibrated: the unit is settling.
const SETTLING: u32 = 1 << 7;
/// Status bits of a temperature or ramp that the fit has not seen: beyond its range, or not together.
const UNSEEN: u32 = 1 << 1 | 1 << 2 | 1 << 11;

/// One axis on the third run.
#[derive(Debug, Clone)]
pub struct OnThird {
    /// The image's bias and noise about their mean, in floors.
    pub image_floors: f64,
    /// The same of the baseline.
    pub baseline_floors: f64,
    /// Squared error of the bias over the variance that is stated, constant included: means over the run where the unit flags nothing.
    pub squared: Option<f64>,
    /// The same where the unit flags what the fit has not seen.
    pub unseen: Option<f64>,
    /// Shares of the means within 1 and 1.96 standard uncertainties there.
    pub within: [f64; 2],
    /// Means behind those.
    pub count: usize,
}

impl OnThird {
    /// `true` if the image leaves a tenth less than the baseline.
    #[must_use]
    pub fn helps(&self) -> bool {
        self.image_floors < 0.9 * self.baseline_floors
    }

    /// `true` if it leaves a twentieth more.
    #[must_use]
    pub fn hurts(&self) -> bool {
        self.image_floors > 1.05 * self.baseline_floors
    }
}

/// Means of columns of a file that `hrg correct` has written, by name.
struct Corrected {
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Corrected {
    fn of(hrg: &Path, run: &Path, calibration: &Path, scratch: &Path) -> Result<Option<Self>> {
        let out = Command::new(hrg)
            .arg("correct")
            .arg(run)
            .arg("--calibration")
            .arg(calibration)
            .arg("-o")
            .arg(scratch)
            .output()?;
        if out.status.code() == Some(2) {
            return Ok(None);
        }
        if !out.status.success() {
            bail!("hrg correct failed: {}", String::from_utf8_lossy(&out.stderr));
        }
        let text = std::fs::read_to_string(scratch)?;
        std::fs::remove_file(scratch)?;
        let mut lines = text.lines().filter(|l| !l.starts_with('#'));
        let names = lines.next().context("an empty file")?.split(',').map(String::from).collect();
        let rows = lines.map(|l| l.split(',').map(|v| v.parse().unwrap_or(f64::NAN)).collect()).collect();
        Ok(Some(Self { names, rows }))
    }

    /// Means of a column over 100 s each; NaN where a stretch has no value.
    fn means(&self, name: &str, of: impl Fn(f64) -> f64) -> Result<Vec<f64>> {
        let place = |name: &str| self.names.iter().position(|n| n == name).with_context(|| format!("no column {name}"));
        let (time, k) = (place("time_s")?, place(name)?);
        let value = |r: &[f64], k: usize| r.get(k).copied().unwrap_or(f64::NAN);
        let Some(first_s) = self.rows.first().map(|r| value(r, time)) else { return Ok(vec![]) };
        let mut sums: Vec<(f64, f64)> = Vec::new();
        for r in &self.rows {
            let at = ((value(r, time) - first_s) / MEAN_S).max(0.0) as usize;
            if at >= sums.len() {
                sums.resize(at + 1, (0.0, 0.0));
            }
            let v = of(value(r, k));
            if v.is_finite() {
                sums[at] = (sums[at].0 + v, sums[at].1 + 1.0);
            }
        }
        Ok(sums.into_iter().map(|(sum, n)| sum / n).collect())
    }
}

/// The image of a calibration file, and the baseline's, on the third run of a truth: by axis. Empty where there is none, or no image.
///
/// # Errors
/// A program that fails, or a file that cannot be read.
pub fn third(hrg: &Path, truth: &Value, folder: &Path, image: &Path, baseline: &Path) -> Result<Vec<OnThird>> {
    let Some(run) = truth["runs"].as_array().into_iter().flatten().find(|r| r["role"] == "judge") else {
        return Ok(vec![]);
    };
    let file = folder.join(run["file"].as_str().unwrap_or(""));
    if !(image.exists() && baseline.exists()) {
        return Ok(vec![]);
    }
    let scratch = image.with_extension("corrected.csv");
    let (Some(ours), Some(theirs)) =
        (Corrected::of(hrg, &file, image, &scratch)?, Corrected::of(hrg, &file, baseline, &scratch)?)
    else {
        return Ok(vec![]);
    };
    let mut out = Vec::new();
    for (axis, figures) in run["axes"].as_object().into_iter().flatten() {
        let bias: Vec<f64> = run["bias_dph"][axis].as_array().into_iter().flatten().filter_map(Value::as_f64).collect();
        let floor = figures["floor_dph"].as_f64().context("a floor")?;
        let error = |c: &Corrected| -> Result<Vec<f64>> {
            let stated = c.means(&format!("bias_{axis}_dph"), |v| v)?;
            Ok(stated.iter().zip(&bias).map(|(s, b)| s - b).collect())
        };
        let (own, base) = (error(&ours)?, error(&theirs)?);
        let std = ours.means(&format!("bias_std_{axis}_dph"), |v| v)?;
        let share = |bits: u32| ours.means(&format!("status_{axis}"), |v| f64::from(u8::from((v as u32) & bits != 0)));
        let (flagged, unseen) = (share(!SETTLING)?, share(UNSEEN)?);
        let floors = |e: &[f64]| {
            let good: Vec<f64> = e.iter().copied().filter(|v| v.is_finite()).collect();
            (crate::means::deviation(&good).powi(2) + floor * floor).sqrt() / floor
        };
        let rows = |of: &dyn Fn(usize) -> bool| -> Vec<(f64, f64)> {
            let rows = own.iter().zip(&std).map(|(e, s)| (*e, *s)).enumerate();
            rows.filter(|(k, (e, s))| e.is_finite() && *s > 0.0 && of(*k)).map(|(_, row)| row).collect()
        };
        let squared = |rows: &[(f64, f64)]| {
            let (squares, variances) = rows.iter().fold((0.0, 0.0), |(a, b), (e, s)| (a + e * e, b + s * s));
            (rows.len() > 10).then(|| squares / variances)
        };
        let stated = rows(&|k| flagged[k] < 0.5);
        let n = stated.len();
        let within = [1.0, 1.96].map(|k| stated.iter().filter(|(e, s)| e.abs() < k * s).count() as f64 / n as f64);
        out.push(OnThird {
            image_floors: floors(&own),
            baseline_floors: floors(&base),
            squared: squared(&stated),
            unseen: squared(&rows(&|k| unseen[k] >= 0.5)),
            within,
            count: n,
        });
    }
    Ok(out)
}
