//! ROS bags as MCAP, read by the crate mcap: `sensor_msgs/Imu` with `sensor_msgs/Temperature`, as ROS 2 (CDR) and ROS 1 encode them.

use super::map::Map;
use super::{at_times, Table};
use crate::error::BadInput;
use mcap::records::{Channel, Record};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::BTreeMap;

/// First bytes of a file.
pub const HEAD: [u8; 8] = *b"\x89MCAP0\r\n";

/// The bytes of a message, read in order.
struct Cursor<'m> {
    bytes: &'m [u8],
    at: usize,
    /// CDR aligns each value to its length and ends texts by a zero; ROS 1 does neither.
    aligned: bool,
    little: bool,
}

impl<'m> Cursor<'m> {
    fn new(encoding: &str, data: &'m [u8]) -> Option<Self> {
        match encoding {
            "ros1" => Some(Self { bytes: data, at: 0, aligned: false, little: true }),
            // (Four bytes of encapsulation: 0, and 1 for little-endian. Alignment counts from behind them.)
            "cdr" => Some(Self { bytes: data.get(4..)?, at: 0, aligned: true, little: data[1] & 1 == 1 }),
            _ => None,
        }
    }

    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        if self.aligned {
            self.at = self.at.next_multiple_of(N);
        }
        let mut bytes: [u8; N] = self.bytes.get(self.at..self.at + N)?.try_into().ok()?;
        self.at += N;
        if !self.little {
            bytes.reverse();
        }
        Some(bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    fn f64(&mut self) -> Option<f64> {
        self.take().map(f64::from_le_bytes)
    }

    /// Passes a `std_msgs/Header`; gives its stamp, s, and the name of its frame.
    fn header(&mut self) -> Option<(f64, &'m [u8])> {
        if !self.aligned {
            self.u32()?; // Sequence number.
        }
        let (seconds, nanoseconds) = (self.u32()?, self.u32()?);
        let length = self.u32()? as usize;
        let from = self.at;
        self.at = self.at.checked_add(length)?;
        let frame = self.bytes.get(from..self.at)?;
        Some((f64::from(seconds) + 1e-9 * f64::from(nanoseconds), frame.strip_suffix(&[0]).unwrap_or(frame)))
    }
}

/// Time, rates and accelerations of a message.
fn imu<'m>(c: &mut Cursor<'m>) -> Option<([f64; 7], &'m [u8])> {
    let (time, frame) = c.header()?;
    let mut next = || c.f64();
    // Orientation, and its covariance.
    for _ in 0..4 + 9 {
        next()?;
    }
    let [x, y, z] = [next()?, next()?, next()?];
    for _ in 0..9 {
        next()?;
    }
    let accelerations = [next()?, next()?, next()?];
    // (A covariance that begins with -1: the unit has no accelerometers.)
    let [ax, ay, az] = if next()? < 0.0 { [f64::NAN; 3] } else { accelerations };
    Some(([time, x, y, z, ax, ay, az], frame))
}

fn temperature(c: &mut Cursor<'_>) -> Option<[f64; 2]> {
    Some([c.header()?.0, c.f64()?])
}

/// Rows of each topic.
#[derive(Default)]
struct Bag {
    imus: BTreeMap<String, Vec<[f64; 7]>>,
    temperatures: BTreeMap<String, Vec<[f64; 2]>>,
    others: BTreeMap<String, String>,
    /// The first frame of each topic with an IMU.
    frames: BTreeMap<String, Vec<u8>>,
    /// Messages of these kinds that could not be read.
    unread: usize,
    cut: bool,
}

impl Bag {
    /// `logged_s`: when the message was recorded, for those whose header has no time.
    fn take(&mut self, (topic, encoding, schema): (&str, &str, &str), data: &[u8], logged_s: f64) {
        let timed = |t: f64| if t > 0.0 { t } else { logged_s };
        let cursor = Cursor::new(encoding, data);
        match schema.rsplit('/').next() {
            Some("Imu") if schema.starts_with("sensor_msgs") => match cursor.and_then(|mut c| imu(&mut c)) {
                Some((mut row, frame)) => {
                    // (Several IMUs may share a topic, each with its frame.)
                    let first = self.frames.entry(topic.to_string()).or_insert_with(|| frame.to_vec());
                    let own = if first == frame {
                        topic.to_string()
                    } else {
                        format!("{topic} ({})", String::from_utf8_lossy(frame))
                    };
                    row[0] = timed(row[0]);
                    self.imus.entry(own).or_default().push(row);
                }
                None => self.unread += 1,
            },
            Some("Temperature") if schema.starts_with("sensor_msgs") => {
                match cursor.and_then(|mut c| temperature(&mut c)) {
                    Some([t, v]) => self.temperatures.entry(topic.to_string()).or_default().push([timed(t), v]),
                    None => self.unread += 1,
                }
            }
            _ => drop(self.others.entry(topic.to_string()).or_insert_with(|| schema.to_string())),
        }
    }
}

/// Longest record of a bag that is read, bytes: a larger length is a defect.
const LONGEST_RECORD: usize = 64 << 20;

/// The rows of a bag, as far as it can be read.
fn bag(bytes: &[u8]) -> Bag {
    let options = LinearReaderOptions::default()
        .with_record_length_limit(LONGEST_RECORD)
        .with_validate_chunk_crcs(true)
        .with_skip_end_magic(true);
    let mut reader = LinearReader::new_with_options(options);
    let mut bag = Bag::default();
    let (mut schemas, mut channels) = (BTreeMap::<u16, String>::new(), BTreeMap::<u16, Channel>::new());
    let mut rest = bytes;
    while let Some(event) = reader.next_event() {
        match event {
            Ok(LinearReadEvent::ReadRequest(wanted)) => {
                let given = wanted.min(rest.len());
                // (A recorder that was stopped by force leaves no end.)
                if given == 0 {
                    bag.cut = true;
                    break;
                }
                reader.insert(given).copy_from_slice(&rest[..given]);
                reader.notify_read(given);
                rest = &rest[given..];
            }
            Ok(LinearReadEvent::Record { data, opcode }) => match mcap::parse_record(opcode, data) {
                Ok(Record::Schema { header, .. }) => drop(schemas.insert(header.id, header.name)),
                Ok(Record::Channel(channel)) => drop(channels.insert(channel.id, channel)),
                Ok(Record::Message { header, data }) => {
                    if let Some(c) = channels.get(&header.channel_id) {
                        let schema = schemas.get(&c.schema_id).map_or("", String::as_str);
                        let logged_s = header.log_time as f64 * 1e-9;
                        bag.take((&c.topic, &c.message_encoding, schema), &data, logged_s);
                    }
                }
                _ => {}
            },
            Err(_) => {
                bag.cut = true;
                break;
            }
        }
    }
    // (Messages of a bag are in no order.)
    bag.imus.values_mut().for_each(|rows| rows.sort_by(|a, b| a[0].total_cmp(&b[0])));
    bag.temperatures.values_mut().for_each(|rows| rows.sort_by(|a, b| a[0].total_cmp(&b[0])));
    bag
}

/// The topic of the temperatures that are an IMU's: the one whose name has most of its parts in common.
fn nearest<'t>(imu: &str, topics: impl Iterator<Item = &'t String>) -> Option<&'t String> {
    let common = |t: &str| imu.split('/').zip(t.split('/')).take_while(|(a, b)| a == b).count();
    topics.max_by_key(|t| common(t))
}

/// Reads the columns that a map wants: `time` (seconds since 1970), `x`, `y`, `z` (rad/s), `ax`, `ay`, `az` (m/s^2), `temperature` (C).
///
/// # Errors
/// One sentence: no bag, or none with an IMU, with the topics that it has.
pub fn read(bytes: &[u8], map: &Map) -> Result<Table, BadInput> {
    let read = crate::error::caught(|| bag(bytes));
    let bag = read.map_err(|_| BadInput::new("the bag is defective: its reader fails on it; record it again"))?;
    let named = map.topics().first().copied();
    let found = match named {
        Some(topic) => bag.imus.get_key_value(topic),
        None => bag.imus.iter().nth(usize::from(map.table.instance)),
    };
    let Some((topic, rows)) = found else {
        let imus: Vec<&String> = bag.imus.keys().collect();
        let others: Vec<String> = bag.others.iter().map(|(t, s)| format!("{t} ({s})")).collect();
        return Err(BadInput(if imus.is_empty() {
            format!("the bag has no sensor_msgs/Imu; it has {}", crate::error::list(&others))
        } else {
            let wanted = named.map_or_else(|| format!("IMU {}", map.table.instance), ToString::to_string);
            format!("the bag has no {wanted}; its IMUs, from 0, are {}", crate::error::list(&imus))
        }));
    };
    let times: Vec<f64> = rows.iter().map(|r| r[0]).collect();
    let mut all = vec![("time".to_string(), times.clone())];
    let column = |(n, k): (&str, usize)| (n.to_string(), rows.iter().map(|r| r[k]).collect::<Vec<f64>>());
    all.extend(["x", "y", "z"].into_iter().zip(1..).map(column));
    // (Zeros alone are of a unit without accelerometers, too.)
    if rows.iter().any(|r| r[4..].iter().any(|v| v.is_finite() && *v != 0.0)) {
        all.extend(["ax", "ay", "az"].into_iter().zip(4..).map(column));
    }
    let from = if let Some(thermometer) = nearest(topic, bag.temperatures.keys()) {
        let rows = &bag.temperatures[thermometer];
        let (own, values): (Vec<f64>, Vec<f64>) = rows.iter().map(|r| (r[0], r[1])).unzip();
        all.push(("temperature".into(), at_times(&times, &own, &values)));
        format!("rates of {topic}, temperatures of {thermometer}")
    } else {
        format!("rates of {topic}; the bag has no sensor_msgs/Temperature, so there is no temperature")
    };
    let mut table = Table::of(all, map)?;
    table.notes.push(from);
    let others: Vec<String> =
        bag.imus.keys().enumerate().filter(|(_, t)| *t != topic).map(|(n, t)| format!("{n} ({t})")).collect();
    if !others.is_empty() {
        table.notes.push(format!("the bag has other IMUs: {}; --imu N takes one", crate::error::list(&others)));
    }
    if bag.unread > 0 {
        table.notes.push(format!("{} messages have another layout than their schema's: left out", bag.unread));
    }
    if bag.cut {
        table.notes.push("the bag ends within a record, or one is defective: what is before it is used".into());
    }
    Ok(table)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Recording;
    use std::collections::BTreeMap;

    /// A message in CDR, little-endian.
    struct Cdr(Vec<u8>);

    impl Cdr {
        fn new() -> Self {
            Self(vec![0, 1, 0, 0])
        }

        fn put(mut self, bytes: &[u8]) -> Self {
            while !(self.0.len() - 4).is_multiple_of(bytes.len()) {
                self.0.push(0);
            }
            self.0.extend(bytes);
            self
        }

        fn header(self, time_ms: u32) -> Self {
            let mut c = self.put(&(1_700_000_000 + time_ms / 1000).to_le_bytes());
            c = c.put(&(time_ms % 1000 * 1_000_000).to_le_bytes()).put(&5u32.to_le_bytes());
            c.0.extend(b"imu0\0");
            c
        }

        fn numbers(self, values: &[f64]) -> Self {
            values.iter().fold(self, |c, v| c.put(&v.to_le_bytes()))
        }
    }

    fn written(compression: Option<mcap::Compression>) -> Vec<u8> {
        let mut file = std::io::Cursor::new(Vec::new());
        let options = mcap::WriteOptions::new().compression(compression).profile("ros2");
        let mut w = options.create(&mut file).expect("opens");
        let none = BTreeMap::new();
        let imu = w.add_schema("sensor_msgs/msg/Imu", "ros2msg", b"").expect("added");
        let warm = w.add_schema("sensor_msgs/msg/Temperature", "ros2msg", b"").expect("added");
        let channels = [(imu, "/a/imu"), (imu, "/b/imu"), (warm, "/b/temperature")];
        let ids = channels.map(|(schema, topic)| w.add_channel(schema, topic, "cdr", &none).expect("added"));
        for k in 0..300u32 {
            let (ms, rate) = (k * 10, 0.001 * f64::from(k));
            for (n, id) in ids.iter().enumerate().filter(|(n, _)| *n < 2 || k % 100 == 0) {
                let c = Cdr::new().header(ms);
                let c = match n {
                    2 => c.numbers(&[20.0 + f64::from(k), 0.0]),
                    // (The first IMU has no accelerometers.)
                    _ => {
                        let gravity = [0.0, 0.0, 9.8 * n as f64];
                        let rates = [rate, -rate, n as f64];
                        c.numbers(&[[0.0; 13].as_slice(), &rates, &[0.0; 9], &gravity, &[0.0; 9]].concat())
                    }
                };
                let header = mcap::records::MessageHeader {
                    channel_id: *id,
                    sequence: k,
                    log_time: u64::from(ms),
                    publish_time: u64::from(ms),
                };
                w.write_to_known_channel(&header, &c.0).expect("written");
            }
        }
        w.finish().expect("finishes");
        drop(w);
        file.into_inner()
    }

    fn map(instance: u8) -> Map {
        let mut map = Map::built_in("ros").expect("there");
        map.table.instance = instance;
        map
    }

    #[test]
    fn an_imu_with_the_temperature_of_its_neighbour() {
        for compression in [None, Some(mcap::Compression::Zstd), Some(mcap::Compression::Lz4)] {
            let path = std::env::temp_dir().join(format!("hrg-mcap-{}.mcap", std::process::id()));
            std::fs::write(&path, written(compression)).expect("written");
            assert_eq!(crate::recording::import::built_in(&path), Some("ros"));
            let r = crate::recording::import::read(&path, &map(1)).expect("fits");
            assert_eq!((r.time_s.len(), r.frequency_hz[0][50]), (300, 70.0));
            assert!((r.time_s[1] - 0.01).abs() < 1e-6 && (r.rate_dph[2][0] - 206_264.806_247).abs() < 1e-3);
            assert!((r.rate_dph[1][100] + 0.1 * 206_264.806_247).abs() < 1e-3);
            assert!(r.notes.iter().any(|n| n.contains("other IMUs: 0 (/a/imu)")), "{:?}", r.notes);
            let force = |r: &Recording| r.column("force_z_mps2").map(|f| f[7]);
            assert_eq!(force(&r), Some(9.8));
            assert_eq!(force(&crate::recording::import::read(&path, &map(0)).expect("fits")), None);
        }
    }

    #[test]
    fn what_is_cut_or_missing_is_reported() {
        let whole = written(None);
        let cut = read(&whole[..whole.len() / 2], &map(0)).expect("the beginning");
        assert!(cut.notes.iter().any(|n| n.contains("ends within a record")) && cut.rows() > 50, "{:?}", cut.notes);
        let e = read(&whole, &map(7)).expect_err("no such").0;
        assert!(e.contains("no IMU 7; its IMUs, from 0, are /a/imu and /b/imu"), "{e}");
        let e = read(b"\x89MCAP0\r\nnonsense, and more of it", &map(0)).expect_err("none").0;
        assert!(e.contains("no sensor_msgs/Imu") || e.contains("cannot be read"), "{e}");
    }
}
