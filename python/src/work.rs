//! Long work beside the interpreter: the lock is released, progress is told, and Ctrl-C stops it.

use crate::refused;
use hrg_data::numeric::progress;
use pyo3::prelude::*;
use std::sync::mpsc::{channel, RecvTimeoutError};
use std::sync::Mutex;
use std::time::Duration;

/// Signals are looked at, and progress is told, so often.
const LOOK: Duration = Duration::from_millis(100);

/// Runs `job` without the interpreter's lock. `tell`: called with the number of models that were tried so far, and the thousandths of the
/// work that are done; what it raises stops the job, as Ctrl-C does.
pub fn run<T: Send>(
    py: Python<'_>,
    tell: Option<&Py<PyAny>>,
    job: impl FnOnce() -> anyhow::Result<T> + Send,
) -> PyResult<T> {
    let own = progress::Work::new();
    let mine = own.clone();
    std::thread::scope(|scope| {
        let (done, finished) = channel();
        let finished = Mutex::new(finished);
        let worker = scope.spawn(move || {
            let result = mine.run(job);
            // (The receiver is gone if the job was stopped.)
            let _ = done.send(());
            result
        });
        // (Once at its beginning, and once at its end, however short it is.)
        let report = || tell.map_or(Ok(()), |f| f.call1(py, (own.done(), (own.share() * 1000.0) as u64)).map(drop));
        let mut raised = report().err();
        while raised.is_none() {
            match py.detach(|| finished.lock().map_or(Ok(()), |f| f.recv_timeout(LOOK))) {
                Ok(()) | Err(RecvTimeoutError::Disconnected) => break,
                Err(RecvTimeoutError::Timeout) => {
                    raised = report().and_then(|()| py.check_signals()).err();
                }
            }
        }
        if raised.is_some() {
            own.stop();
        }
        let result = py.detach(|| worker.join());
        match (raised, result) {
            (Some(e), _) => Err(e),
            (None, Ok(Some(result))) => report().and_then(|()| result.map_err(refused)),
            (None, _) => {
                Err(pyo3::exceptions::PyRuntimeError::new_err("the work ended by itself; this is a defect of hrg"))
            }
        }
    })
}
