//! Betaflight's blackbox logs (`.bbl`, `.bfl`), read by the crate blackbox-log: times and `gyroADC`, which has no thermometer.

use super::map::Map;
use super::Table;
use crate::error::BadInput;
use blackbox_log::prelude::*;
use blackbox_log::units::si::angular_velocity::radian_per_second;
use blackbox_log::Value;

/// First line of each log in such a file.
pub const HEAD: [u8; 18] = *b"H Product:Blackbox";

/// Reads the columns that a map wants: `time` in us since power-on, and the fields of the main frames that are rates, in rad/s.
///
/// # Errors
/// One sentence: no log, or none with rates; no such field.
pub fn read(bytes: &[u8], map: &Map) -> Result<Table, BadInput> {
    if map.table.instance > 0 {
        return Err(BadInput::new("a blackbox log has one gyro: leave --imu out"));
    }
    let read = crate::error::caught(|| columns(bytes));
    let (columns, logs) = read.unwrap_or_else(|_| {
        Err(BadInput::new("the log is defective: its reader fails on it; copy it from the flight controller again"))
    })?;
    let mut table = Table::of(columns, map)?;
    if logs > 1 {
        table.notes.push(format!("the file holds {logs} logs, one after another in this recording"));
    }
    Ok(table)
}

type Columns = Vec<(String, Vec<f64>)>;

/// The columns of all logs of a file, and the number of logs.
fn columns(bytes: &[u8]) -> Result<(Columns, usize), BadInput> {
    let mut out = Columns::new();
    let mut logs = 0;
    for headers in blackbox_log::File::new(bytes).iter() {
        let headers = headers.map_err(|e| BadInput(format!("it is no blackbox log that can be read: {e}")))?;
        let names: Vec<String> = headers.main_frame_def().iter().map(|f| f.name.to_string()).collect();
        let mut parser = headers.data_parser();
        let mut frames = 0usize;
        while let Some(event) = parser.next() {
            let ParserEvent::Main(frame) = event else { continue };
            frames += 1;
            let rates = names.iter().zip(frame.iter()).filter_map(|(n, v)| match v.into() {
                Value::Rotation(rate) => Some((n.as_str(), rate.get::<radian_per_second>())),
                _ => None,
            });
            for (name, value) in std::iter::once(("time", frame.time_raw() as f64)).chain(rates) {
                match out.iter_mut().find(|(n, _)| n == name) {
                    Some((_, values)) => values.push(value),
                    None => out.push((name.to_string(), vec![value])),
                }
            }
        }
        logs += usize::from(frames > 0);
    }
    if out.is_empty() {
        return Err(BadInput::new("the blackbox log holds no frame"));
    }
    Ok((out, logs))
}
