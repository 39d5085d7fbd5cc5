//! Recordings: any bytes are read, cleaned and brought to model steps, or refused with a sentence; so is a chamber's log beside one.

use hrg_data::recording::merge::{merge, Wanted};
use hrg_data::recording::steps::Steps;
use hrg_data::recording::Recording;

/// Takes an input; it panics where something promised does not hold.
pub fn run(data: &[u8]) {
    if let Ok(mut r) = Recording::parse(data) {
        let rows = r.time_s.len();
        if r.clean().is_ok() {
            assert!(r.time_s.len() <= rows && r.time_s.windows(2).all(|w| w[0] < w[1]));
            let again = Recording::parse(r.to_csv().as_bytes()).expect("what we write we read");
            assert_eq!(again.time_s.len(), r.time_s.len());
            // Times that span months make as many steps: not what is looked for here.
            if r.time_s.last().zip(r.time_s.first()).is_some_and(|(b, a)| b - a < 1e5) {
                if let Ok(steps) = Steps::new(&r) {
                    assert!(steps.frequency_hz.iter().all(|f| f.len() == steps.len()));
                }
            }
        }
    }
    if let Ok(text) = std::str::from_utf8(data) {
        // A log of anything beside a recording that is one.
        const RUN: &str = "time_s,fx_hz,fy_hz,fz_hz,rate_x_dph,rate_y_dph,rate_z_dph\n1,2,3,4,5,6,7\n2,2,3,4,5,6,7\n";
        let wanted = Wanted::parse("t", &["chamber_c=T".to_string()]).expect("fine");
        if let Ok(merged) = merge(RUN, text, "log", &wanted) {
            assert_eq!(Recording::parse(merged.text.as_bytes()).expect("what we write we read").time_s, [1.0, 2.0]);
        }
        let _ = hrg_align_tools::Recording::parse(text);
    }
}
