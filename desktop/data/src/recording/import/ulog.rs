//! PX4's logs: one instance of one topic. The file is read by the crate px4-ulog, message by message.

use super::map::Map;
use super::{choose, Table};
use crate::error::BadInput;
use px4_ulog::stream_parser::model::{Completeness, DataMessage, FlattenedField, FlattenedFieldType};
use px4_ulog::stream_parser::{read_file_with_simple_callback, Message, SimpleCallbackResult};
use std::collections::BTreeSet;
use std::path::Path;

/// The value of a field; `None` where the message is too short for it.
fn value(m: &DataMessage<'_>, f: &FlattenedField) -> Option<f64> {
    fn bytes<const N: usize>(data: &[u8], at: usize) -> Option<[u8; N]> {
        data.get(at..at + N)?.try_into().ok()
    }
    let (d, at) = (m.data, usize::from(f.offset));
    Some(match f.field_type {
        FlattenedFieldType::Int8 => f64::from(i8::from_le_bytes(bytes(d, at)?)),
        FlattenedFieldType::UInt8 | FlattenedFieldType::Bool | FlattenedFieldType::Char => f64::from(*d.get(at)?),
        FlattenedFieldType::Int16 => f64::from(i16::from_le_bytes(bytes(d, at)?)),
        FlattenedFieldType::UInt16 => f64::from(u16::from_le_bytes(bytes(d, at)?)),
        FlattenedFieldType::Int32 => f64::from(i32::from_le_bytes(bytes(d, at)?)),
        FlattenedFieldType::UInt32 => f64::from(u32::from_le_bytes(bytes(d, at)?)),
        FlattenedFieldType::Int64 => i64::from_le_bytes(bytes(d, at)?) as f64,
        FlattenedFieldType::UInt64 => u64::from_le_bytes(bytes(d, at)?) as f64,
        FlattenedFieldType::Float => f64::from(f32::from_le_bytes(bytes(d, at)?)),
        FlattenedFieldType::Double => f64::from_le_bytes(bytes(d, at)?),
    })
}

/// Reads the topic that a map names.
///
/// # Errors
/// One sentence: no such topic, with those that are there; no such field; not a log.
pub fn read(path: &Path, map: &Map) -> Result<Table, BadInput> {
    let topic = map
        .table
        .topic
        .as_deref()
        .ok_or_else(|| BadInput::new("the map is for PX4 logs and names no topic in [table]"))?;
    let name = path.to_str().ok_or_else(|| BadInput::new("the path is not UTF-8; rename the file"))?;
    let mut seen: BTreeSet<String> = BTreeSet::new();
    let mut table = Table::default();
    let mut fields: Vec<FlattenedField> = Vec::new();
    let (mut problem, mut dropouts, mut to_drop) = (None, 0usize, map.table.drop_rows);
    let mut take = |m: &Message<'_>| {
        match m {
            Message::Data(m) => {
                let format = &m.flattened_format;
                let (this, instance) = (&format.message_name, m.multi_id.value());
                if this != topic || instance != map.table.instance {
                    if seen.len() < 400 {
                        seen.insert(format!("{this} {instance}"));
                    }
                    return SimpleCallbackResult::KeepReading;
                }
                if fields.is_empty() {
                    let there: Vec<String> = format.fields.iter().map(|f| f.flattened_field_name.clone()).collect();
                    match choose(map, &there) {
                        Ok(wanted) => {
                            fields = wanted.iter().map(|(at, _)| format.fields[*at].clone()).collect();
                            table.columns = wanted.into_iter().map(|(_, n)| (n, Vec::new())).collect();
                        }
                        Err(e) => {
                            problem = Some(e);
                            return SimpleCallbackResult::Stop;
                        }
                    }
                }
                if to_drop > 0 {
                    to_drop -= 1;
                } else {
                    for (f, (_, values)) in fields.iter().zip(&mut table.columns) {
                        values.push(value(m, f).filter(|v| v.is_finite()).unwrap_or(f64::NAN));
                    }
                }
            }
            Message::DropoutMessage(_) => dropouts += 1,
            _ => {}
        }
        SimpleCallbackResult::KeepReading
    };
    let end = read_file_with_simple_callback(name, &mut take)
        .map_err(|e| BadInput(format!("cannot be read as a PX4 log: {e}; check that it is the right file")))?;
    if let Some(e) = problem {
        return Err(e);
    }
    if fields.is_empty() {
        let seen: Vec<String> = seen.into_iter().collect();
        return Err(BadInput(format!(
            "the log has no {topic} {}; it has {} (topic, instance)",
            map.table.instance,
            if seen.is_empty() { "no data".into() } else { seen.join(", ") }
        )));
    }
    if dropouts > 0 {
        table.notes.push(format!("{dropouts} dropouts: the logger could not write fast enough"));
    }
    match end {
        Completeness::Complete => {}
        Completeness::Truncated => table.notes.push("the log ends within a message: what is before it is used".into()),
        Completeness::MalformedRecord(why) => {
            table.notes.push(format!("the log has a corrupted message ({why}): what is before it is used"));
        }
    }
    Ok(table)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::import::map::BUILT_IN;

    /// A log by PX4's published description of the format: header, definitions, then data.
    struct Log(Vec<u8>);

    impl Log {
        fn new() -> Self {
            let mut b = vec![0x55, 0x4c, 0x6f, 0x67, 0x01, 0x12, 0x35, 0x01];
            b.extend(1_000_000u64.to_le_bytes());
            let mut log = Self(b);
            // Flag bits: 8 compatible, 8 incompatible, three offsets of appended data.
            log.message(b'B', &[0; 40]);
            log.message(b'F', b"sensor_gyro:uint64_t timestamp;uint32_t device_id;float x;float y;float z;float temperature;uint8_t[4] _padding0;");
            log.message(b'F', b"battery:uint64_t timestamp;float voltage;");
            for (instance, id, name) in [(0u8, 3u16, "sensor_gyro"), (1, 4, "sensor_gyro"), (0, 7, "battery")] {
                let mut m = vec![instance];
                m.extend(id.to_le_bytes());
                m.extend(name.as_bytes());
                log.message(b'A', &m);
            }
            log
        }

        fn message(&mut self, kind: u8, payload: &[u8]) {
            self.0.extend((payload.len() as u16).to_le_bytes());
            self.0.push(kind);
            self.0.extend(payload);
        }

        fn gyro(&mut self, id: u16, time_us: u64, rates: [f32; 3], temperature: f32) {
            let mut m = id.to_le_bytes().to_vec();
            m.extend(time_us.to_le_bytes());
            m.extend(42u32.to_le_bytes());
            // (Padding at the end of a topic is not logged.)
            rates.iter().chain([&temperature]).for_each(|v| m.extend(v.to_le_bytes()));
            self.message(b'D', &m);
        }

        fn save(&self, name: &str) -> std::path::PathBuf {
            let path = std::env::temp_dir().join(format!("hrg-ulog-{}-{name}.ulg", std::process::id()));
            std::fs::write(&path, &self.0).expect("written");
            path
        }
    }

    fn map() -> Map {
        Map::parse(BUILT_IN.iter().find(|(n, _)| *n == "px4").expect("there").1).expect("a map")
    }

    #[test]
    fn one_instance_of_the_gyro_is_read() {
        let mut log = Log::new();
        for k in 0..50u64 {
            log.gyro(3, 2_000_000 + k * 4000, [0.001 * k as f32, -0.5, 0.25], 40.0 + 0.5 * k as f32);
            log.gyro(4, 2_000_000 + k * 4000, [9.0; 3], 99.0);
        }
        log.message(b'O', &5u16.to_le_bytes());
        let path = log.save("good");
        let r = crate::recording::import::read(&path, &map()).expect("fits");
        assert_eq!((r.time_s.len(), r.time_s[1], r.frequency_hz[0][2]), (50, 2.004, 41.0));
        assert!((r.rate_dph[1][7] + 0.5 * 206_264.806_247).abs() < 1e-3);
        assert!(r.notes.iter().any(|n| n.contains("1 dropouts")), "{:?}", r.notes);
        // Cut off in the middle of a message, as by a power loss.
        log.0.truncate(log.0.len() - 60);
        let cut = crate::recording::import::read(&log.save("cut"), &map()).expect("the beginning is there");
        assert!(
            cut.time_s.len() >= 48 && cut.notes.iter().any(|n| n.contains("ends within a message")),
            "{:?}",
            cut.notes
        );
    }

    #[test]
    fn missing_columns_are_reported_with_those_present() {
        let mut log = Log::new();
        let mut m = 7u16.to_le_bytes().to_vec();
        m.extend(1u64.to_le_bytes());
        m.extend(12f32.to_le_bytes());
        log.message(b'D', &m);
        let e = read(&log.save("other"), &map()).expect_err("no gyro").0;
        assert!(e.contains("no sensor_gyro 0") && e.contains("battery 0"), "{e}");
        log.gyro(3, 1, [0.0; 3], 20.0);
        let mut other = map();
        other.rate.get_mut("x").expect("there").column =
            crate::recording::import::map::Names::One("gyro_rad[0]".into());
        let e = read(&log.save("field"), &other).expect_err("no field").0;
        assert!(e.contains("gyro_rad[0]") && e.contains("\"temperature\""), "{e}");
        let junk = Log(b"time_s,fx_hz\n1,2\n".to_vec());
        let e = read(&junk.save("junk"), &map()).expect_err("no log").0;
        assert!(e.contains("PX4 log"), "{e}");
    }
}
