//! A bar for work that takes more than a second: how much is done, and how long the rest may take. On a terminal only.

use hrg_data::numeric::progress::{continued, Work};
use std::io::IsTerminal;
use std::sync::mpsc::{channel, Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

/// Nothing is shown of work that is shorter.
const SHOWN_AFTER: Duration = Duration::from_secs(1);
/// The bar is drawn anew so often.
const DRAWN_EACH: Duration = Duration::from_millis(100);

/// Runs a job, with a bar on standard error while it lasts.
pub fn with_a_bar<T>(label: &str, job: impl FnOnce() -> T) -> T {
    if !std::io::stderr().is_terminal() {
        return job();
    }
    let work = Work::new();
    let watched = work.clone();
    std::thread::scope(|scope| {
        let (running, ended) = channel();
        scope.spawn(move || draw(label, &watched, &ended));
        let result = continued(Some(work), job);
        drop(running);
        result
    })
}

/// Draws until the job has ended.
fn draw(label: &str, work: &Work, ended: &Receiver<()>) {
    let begun = Instant::now();
    if ended.recv_timeout(SHOWN_AFTER) != Err(RecvTimeoutError::Timeout) {
        return;
    }
    let bar = indicatif::ProgressBar::new(1000);
    let style = |template: &str| indicatif::ProgressStyle::with_template(template).ok();
    let known = style("{msg} {bar:30.cyan} {percent:>3} %{prefix}");
    let unknown = style("{msg} {spinner} {elapsed}");
    bar.set_message(label.to_string());
    while ended.recv_timeout(DRAWN_EACH) == Err(RecvTimeoutError::Timeout) {
        let share = work.share();
        if let Some(style) = if share > 0.0 { &known } else { &unknown } {
            bar.set_style(style.clone());
        }
        bar.set_position((share * 1000.0) as u64);
        bar.set_prefix(left(share, begun.elapsed()));
        bar.tick();
    }
    bar.finish_and_clear();
}

/// Time that is left, in words.
fn left(share: f64, elapsed: Duration) -> String {
    let seconds = elapsed.as_secs_f64() * (1.0 - share) / share;
    match seconds {
        s if !s.is_finite() => String::new(),
        s if s < 90.0 => format!(", about {:.0} s left", s.max(1.0)),
        s => format!(", about {:.0} min left", s / 60.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_left_is_what_the_share_says() {
        let of = |share, s| left(share, Duration::from_secs(s));
        assert_eq!(of(0.25, 10), ", about 30 s left");
        assert_eq!(of(0.5, 600), ", about 10 min left");
        assert_eq!(of(0.0, 10), "");
        assert_eq!(with_a_bar("", || 7), 7);
    }
}
