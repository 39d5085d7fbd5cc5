//! PX4's logs: one instance of one topic. The file is read by the crate px4-ulog, message by message.

use super::map::Map;
use super::{at_times, choose, Table};
use crate::error::BadInput;
use px4_ulog::stream_parser::model::{Completeness, DataMessage, FlattenedField, FlattenedFieldType};
use px4_ulog::stream_parser::{read_file_with_simple_callback, Message, SimpleCallbackResult};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// First bytes of a log.
pub const HEAD: [u8; 4] = *b"ULog";

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

/// Columns of one topic that a map may want.
struct Topic {
    /// Names of all of its fields.
    names: Vec<String>,
    /// The wanted fields, with their values; first its time.
    fields: Vec<FlattenedField>,
    columns: Vec<(String, Vec<f64>)>,
    /// Rows that are still to be dropped.
    to_drop: usize,
}

impl Topic {
    fn new(m: &DataMessage<'_>, map: &Map) -> Self {
        let format = &m.flattened_format;
        let names: Vec<String> = format.fields.iter().map(|f| f.flattened_field_name.clone()).collect();
        let of_other = |n: &str| n.strip_prefix(&format.message_name)?.strip_prefix('.').map(str::to_string);
        let wanted: BTreeSet<String> = map
            .wanted()
            .iter()
            .flat_map(|(_, n, _)| n.all())
            .flat_map(|n| [Some(n.to_string()), of_other(n)])
            .flatten()
            .collect();
        let fields: Vec<FlattenedField> =
            format.fields.iter().filter(|f| wanted.contains(&f.flattened_field_name)).cloned().collect();
        let columns = fields.iter().map(|f| (f.flattened_field_name.clone(), Vec::new())).collect();
        Self { names, fields, columns, to_drop: map.table.drop_rows }
    }

    fn take(&mut self, m: &DataMessage<'_>) {
        if self.to_drop > 0 {
            self.to_drop -= 1;
            return;
        }
        for (f, (_, values)) in self.fields.iter().zip(&mut self.columns) {
            values.push(value(m, f).filter(|v| v.is_finite()).unwrap_or(f64::NAN));
        }
    }

    fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|(n, _)| n == name).map(|(_, v)| v.as_slice())
    }
}

/// The columns that a map wants of the first of its topics that is there, and of others (`topic.field`) at its times.
fn joined(topics: &BTreeMap<String, Topic>, seen: &BTreeSet<String>, map: &Map) -> Result<Table, BadInput> {
    let instance = map.table.instance;
    let Some((name, main)) = map.topics().into_iter().find_map(|t| topics.get_key_value(t)) else {
        let seen: Vec<String> = seen.iter().cloned().collect();
        return Err(BadInput(format!(
            "the log has no {} {instance}; it has {} (topic, instance)",
            map.topics().join(" or "),
            if seen.is_empty() { "no data".into() } else { seen.join(", ") }
        )));
    };
    let mut columns = main.columns.clone();
    let mut there = main.names.clone();
    let time = map.time.column.as_ref().and_then(|c| c.all().into_iter().find_map(|n| Some((n, main.column(n)?))));
    for (other, topic) in topics.iter().filter(|(t, _)| *t != name) {
        let own = time.and_then(|(n, times)| Some((times, topic.column(n)?)));
        for (field, values) in &topic.columns {
            let (Some((times, own)), full) = (own, format!("{other}.{field}")) else { continue };
            if map.wanted().iter().any(|(_, n, _)| n.all().contains(&full.as_str())) {
                // (Times of these logs are microseconds.)
                let [times, own] = [times, own].map(|t| t.iter().map(|t| 1e-6 * t).collect::<Vec<f64>>());
                columns.push((full.clone(), at_times(&times, &own, values)));
                there.push(full);
            }
        }
    }
    let wanted = choose(map, &there)?;
    columns.retain(|(n, _)| wanted.iter().any(|(_, w)| w == n));
    let mut table = Table { columns, ..Table::default() };
    // (By default PX4 logs a single sample of the raw gyro a second.)
    let rows = |t: &Topic| t.columns.first().map_or(0, |(_, v)| v.len());
    let fuller = map.topics().into_iter().filter(|t| *t != name).filter_map(|t| topics.get_key_value(t));
    if let Some((other, more)) = fuller.max_by_key(|(_, t)| rows(t)).filter(|(_, t)| rows(t) > 10 * rows(main)) {
        table.notes.push(format!(
            "{name} has {} rows, each a single sample, where {other} has {}; log the gyro at full rate (SDLOG_PROFILE), or take {other} by a map with its topic",
            rows(main),
            rows(more)
        ));
    }
    if map.topics().first() != Some(&name.as_str()) {
        let thermometer = map.temperature.values().find(|c| table.column(&c.column).is_some());
        let from = thermometer.and_then(|c| c.column.all().into_iter().find(|n| there.iter().any(|t| t == n)));
        table.notes.push(format!(
            "the log has no {}; the rates are those of {name}{}",
            map.topics()[0],
            from.map_or_else(|| ", and there is no temperature".into(), |f| format!(", the temperatures those of {f}"))
        ));
    }
    Ok(table)
}

/// Reads the topic that a map names, and what it wants of others.
///
/// # Errors
/// One sentence: no such topic, with those that are there; no such field; not a log.
pub fn read(path: &Path, map: &Map) -> Result<Table, BadInput> {
    if map.topics().is_empty() {
        return Err(BadInput::new("the map is for PX4 logs and names no topic in [table]"));
    }
    let name = path.to_str().ok_or_else(|| BadInput::new("the path is not UTF-8; rename the file"))?.to_string();
    // (The crate panics on some defective logs: an index beyond a slice.)
    let read = crate::error::caught(|| gathered(&name, map));
    let Gathered { topics, seen, imus, dropouts, end } = read.unwrap_or_else(|_| {
        Err(BadInput::new("the log is defective: its reader fails on it; copy it from the card again"))
    })?;
    let mut table = joined(&topics, &seen, map)?;
    table.notes.extend(super::others(&imus, map.table.instance)?);
    if dropouts > 0 {
        let s = if dropouts == 1 { "" } else { "s" };
        table.notes.push(format!("{dropouts} dropout{s}: the logger could not write fast enough"));
    }
    match end {
        Completeness::Complete => {}
        Completeness::Truncated => table.notes.push("the log ends within a message: what is before it is used".into()),
        Completeness::MalformedRecord(_) => {
            table.notes.push("the log has a corrupted message: what is before it is used".into());
        }
    }
    Ok(table)
}

/// Contents of a log that a map may want.
struct Gathered {
    topics: BTreeMap<String, Topic>,
    /// Topics and instances that no map asked for.
    seen: BTreeSet<String>,
    /// Instances of the topics with rates.
    imus: BTreeSet<u8>,
    dropouts: usize,
    end: Completeness,
}

fn gathered(name: &str, map: &Map) -> Result<Gathered, BadInput> {
    let of_rates = map.topics();
    let wanted: Vec<&str> = {
        let others = map.wanted();
        let others = others.iter().flat_map(|(_, n, _)| n.all()).filter_map(|n| n.split_once('.').map(|(t, _)| t));
        of_rates.iter().copied().chain(others).collect()
    };
    let (mut topics, mut seen, mut imus) = (BTreeMap::<String, Topic>::new(), BTreeSet::new(), BTreeSet::new());
    let mut dropouts = 0;
    let mut take = |m: &Message<'_>| {
        match m {
            Message::Data(m) => {
                let (this, instance) = (&m.flattened_format.message_name, m.multi_id.value());
                if of_rates.contains(&this.as_str()) {
                    imus.insert(instance);
                }
                if !wanted.contains(&this.as_str()) || instance != map.table.instance {
                    if seen.len() < 400 {
                        seen.insert(format!("{this} {instance}"));
                    }
                } else if let Some(topic) = topics.get_mut(this) {
                    topic.take(m);
                } else {
                    let mut topic = Topic::new(m, map);
                    topic.take(m);
                    topics.insert(this.clone(), topic);
                }
            }
            Message::DropoutMessage(_) => dropouts += 1,
            _ => {}
        }
        SimpleCallbackResult::KeepReading
    };
    let end = read_file_with_simple_callback(name, &mut take)
        .map_err(|_| BadInput::new("it does not begin as a PX4 log (ULog); check that it is the right file"))?;
    Ok(Gathered { topics, seen, imus, dropouts, end })
}

#[cfg(test)]
mod tests {
    use super::*;

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
            log.message(b'F', b"sensor_combined:uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;");
            log.message(b'F', b"vehicle_imu_status:uint64_t timestamp;float temperature_gyro;");
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
        Map::built_in("px4").expect("there")
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
        assert!(r.notes.iter().any(|n| n.contains("1 dropout:")), "{:?}", r.notes);
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
        assert!(e.contains("no sensor_gyro or sensor_combined 0") && e.contains("battery 0"), "{e}");
        log.gyro(3, 1, [0.0; 3], 20.0);
        let mut other = map();
        other.table.topic = Some(crate::recording::import::map::Names::One("sensor_gyro".into()));
        other.rate.get_mut("x").expect("there").column =
            crate::recording::import::map::Names::One("gyro_rad[0]".into());
        let e = read(&log.save("field"), &other).expect_err("no field").0;
        assert!(e.contains("gyro_rad[0]") && e.contains("\"temperature\""), "{e}");
        let junk = Log(b"time_s,fx_hz\n1,2\n".to_vec());
        let e = read(&junk.save("junk"), &map()).expect_err("no log").0;
        assert!(e.contains("PX4 log"), "{e}");
    }

    /// As PX4 logs by default: the combined rates, and the temperature of the IMU once a second.
    #[test]
    fn a_log_without_the_raw_gyro_has_the_combined_rates() {
        let mut log = Log::new();
        for (id, name) in [(8u16, "sensor_combined"), (9, "vehicle_imu_status")] {
            let mut m = vec![0];
            m.extend(id.to_le_bytes());
            m.extend(name.as_bytes());
            log.message(b'A', &m);
        }
        for k in 0..500u64 {
            let time = (5_000_000 + 10_000 * k).to_le_bytes();
            let mut m = [8u16.to_le_bytes().to_vec(), time.to_vec()].concat();
            [0.01f32, -0.02, 0.03, 0.0, 0.0, -9.8].iter().for_each(|v| m.extend(v.to_le_bytes()));
            log.message(b'D', &m);
            if k % 100 == 0 {
                let mut m = [9u16.to_le_bytes().to_vec(), time.to_vec()].concat();
                m.extend((30.0 + k as f32 / 100.0).to_le_bytes());
                log.message(b'D', &m);
            }
        }
        let r = crate::recording::import::read(&log.save("combined"), &map()).expect("fits");
        assert_eq!((r.time_s.len(), r.frequency_hz[1][150]), (500, 31.5));
        assert!((r.rate_dph[2][9] - f64::from(0.03f32) * 206_264.806_247).abs() < 1e-3);
        assert!(r.notes.iter().any(|n| n.contains("no sensor_gyro; the rates are those of sensor_combined, the temperatures those of vehicle_imu_status.temperature_gyro")), "{:?}", r.notes);
    }

    /// Logs on which the crate panics, or might: each byte changed.
    #[test]
    fn defective_logs_are_refused_or_read() {
        let mut log = Log::new();
        (0..20).for_each(|k| log.gyro(3, 2_000_000 + k * 4000, [0.0; 3], 40.0));
        let path = log.save("defective");
        for at in 8..log.0.len() {
            for value in [0x00, 0xFF, 0x80, log.0[at] ^ 1] {
                let mut bytes = log.0.clone();
                bytes[at] = value;
                std::fs::write(&path, &bytes).expect("written");
                let _ = read(&path, &map());
            }
        }
    }
}
