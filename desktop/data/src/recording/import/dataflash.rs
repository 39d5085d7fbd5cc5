//! ArduPilot's binary logs (`.bin`): the messages of one name. A log describes itself: FMT messages give the name, the types and the
//! labels of each message. (The crates on offer write or replay such logs; none reads one message's columns.)
//!
//! Format: ArduPilot's `libraries/AP_Logger/LogStructure.h`.

use super::map::Map;
use super::{columnar, Table};
use crate::error::BadInput;
use crate::recording::parquet::Cells;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// First bytes of each message; its type follows.
const HEAD: [u8; 2] = [0xA3, 0x95];

/// The type of the messages that describe the others, and how long they are.
const FMT: u8 = 128;
const FMT_LENGTH: usize = 89;

/// Description of a message type by an FMT message.
#[derive(Debug, Clone)]
struct Described {
    name: String,
    /// Bytes of a message, head and type included.
    length: usize,
    /// Labels with the letter of their types.
    fields: Vec<(String, u8)>,
}

/// Bytes of a field; `None` for a letter that is not known.
fn width(letter: u8) -> Option<usize> {
    Some(match letter {
        b'b' | b'B' | b'M' => 1,
        b'h' | b'H' | b'c' | b'C' | b'g' => 2,
        b'i' | b'I' | b'f' | b'e' | b'E' | b'L' | b'n' => 4,
        b'q' | b'Q' | b'd' => 8,
        b'N' => 16,
        b'Z' | b'a' => 64,
        _ => return None,
    })
}

/// Text up to its first zero.
fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).trim().to_string()
}

impl Described {
    fn of(payload: &[u8]) -> Option<(u8, Self)> {
        let (kind, length) = (*payload.first()?, usize::from(*payload.get(1)?));
        let name = text(payload.get(2..6)?);
        let letters = text(payload.get(6..22)?);
        let labels = text(payload.get(22..86)?);
        let fields: Vec<(String, u8)> = labels.split(',').map(str::to_string).zip(letters.bytes()).collect();
        let wide: Option<usize> = fields.iter().map(|(_, l)| width(*l)).sum();
        // Fields that do not fill their message cannot be read; it is left out by its length.
        let agree = fields.len() == letters.len() && wide.is_some_and(|w| w + 3 == length);
        let fields = if agree { fields } else { Vec::new() };
        (length >= 3).then_some((kind, Self { name, length, fields }))
    }

    fn columns(&self) -> Vec<(String, Cells)> {
        let empty = |letter: u8| match letter {
            b'n' | b'N' | b'Z' | b'a' => Cells::Texts(Vec::new()),
            _ => Cells::Numbers(Vec::new(), None),
        };
        self.fields.iter().map(|(label, letter)| (label.clone(), empty(*letter))).collect()
    }
}

/// A number of a field, as ArduPilot's own tools give it: `c`, `C`, `e` and `E` are hundredths, `L` is degrees.
fn number(letter: u8, b: &[u8]) -> f64 {
    fn array<const N: usize>(b: &[u8]) -> [u8; N] {
        b.try_into().unwrap_or([0; N])
    }
    match letter {
        b'b' => f64::from(i8::from_le_bytes(array(b))),
        b'B' | b'M' => f64::from(u8::from_le_bytes(array(b))),
        b'h' => f64::from(i16::from_le_bytes(array(b))),
        b'H' => f64::from(u16::from_le_bytes(array(b))),
        b'c' => f64::from(i16::from_le_bytes(array(b))) / 100.0,
        b'C' => f64::from(u16::from_le_bytes(array(b))) / 100.0,
        b'i' => f64::from(i32::from_le_bytes(array(b))),
        b'I' => f64::from(u32::from_le_bytes(array(b))),
        b'e' => f64::from(i32::from_le_bytes(array(b))) / 100.0,
        b'E' => f64::from(u32::from_le_bytes(array(b))) / 100.0,
        b'L' => f64::from(i32::from_le_bytes(array(b))) * 1e-7,
        b'f' => f64::from(f32::from_le_bytes(array(b))),
        b'd' => f64::from_le_bytes(array(b)),
        b'q' => i64::from_le_bytes(array(b)) as f64,
        b'Q' => u64::from_le_bytes(array(b)) as f64,
        // Half precision (`g`) is in no message with rates or temperatures.
        _ => f64::NAN,
    }
}

/// `true` if a file begins as such a log does.
#[must_use]
pub fn begins(path: &Path) -> bool {
    crate::files::begins_with(path, [HEAD[0], HEAD[1], FMT])
}

/// Reads the columns that a map wants of the message that it names.
///
/// # Errors
/// One sentence: no such message, with those that are there; no such column.
pub fn read(bytes: &[u8], map: &Map) -> Result<Table, BadInput> {
    let topic = map.topics().first().copied().ok_or_else(|| {
        BadInput::new("the file is an ArduPilot log, and the map names no message: add topic to [table]")
    })?;
    let (taken, by_column) = (map.table.instance, map.table.instance_column.as_deref());
    let mut described: BTreeMap<u8, Described> = BTreeMap::new();
    let mut columns: Vec<(String, Cells)> = Vec::new();
    let (mut seen, mut imus) = (BTreeSet::new(), BTreeSet::new());
    let (mut at, mut skipped, mut cut) = (0, 0usize, false);
    while at + 3 <= bytes.len() {
        let kind = bytes[at + 2];
        let length = if kind == FMT { Some(FMT_LENGTH) } else { described.get(&kind).map(|d| d.length) };
        let Some(length) = length.filter(|_| bytes[at..at + 2] == HEAD) else {
            // Not the beginning of a message that is known: on to the next byte.
            (at, skipped) = (at + 1, skipped + 1);
            continue;
        };
        let Some(payload) = bytes.get(at + 3..at + length) else {
            cut = true;
            break;
        };
        at += length;
        if kind == FMT {
            described.extend(Described::of(payload));
            continue;
        }
        let Some(d) = described.get(&kind) else { continue };
        // (Before 4.0 each IMU had a message of its own, without a column for its number.)
        let has_number = |d: &Described| by_column.is_some_and(|c| d.fields.iter().any(|(label, _)| label == c));
        let imu = match d.name.strip_prefix(topic) {
            _ if d.fields.is_empty() => None,
            Some("") => Some(0),
            Some("2") if by_column.is_some() && !has_number(d) => Some(1),
            Some("3") if by_column.is_some() && !has_number(d) => Some(2),
            _ => None,
        };
        let Some(imu) = imu else {
            seen.insert(d.name.clone());
            continue;
        };
        if !has_number(d) {
            imus.insert(imu);
            if imu != taken {
                continue;
            }
        }
        if columns.is_empty() {
            columns = d.columns();
        }
        let mut from = 0;
        for ((_, letter), (_, cells)) in d.fields.iter().zip(&mut columns) {
            let to = from + width(*letter).unwrap_or(0);
            match cells {
                Cells::Numbers(v, _) => v.push(number(*letter, &payload[from..to])),
                Cells::Texts(v) => v.push(text(&payload[from..to])),
            }
            from = to;
        }
    }
    if columns.is_empty() {
        let seen: Vec<String> = seen.into_iter().collect();
        let others: Vec<String> = imus.iter().map(u8::to_string).collect();
        return Err(BadInput(if others.is_empty() {
            format!("the log has no message {topic}; it has {}", crate::error::list(&seen))
        } else {
            format!("the log has no IMU {taken}; it has {}", crate::error::list(&others))
        }));
    }
    let mut table = columnar::table(&columns, map)?;
    table.notes.extend(super::others(&imus, taken)?);
    if skipped > 0 {
        table.notes.push(format!("{skipped} bytes belong to no message that the log describes: they are left out"));
    }
    if cut {
        table.notes.push("the log ends within a message: what is before it is used".into());
    }
    Ok(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A log with the formats of ArduPilot 4.5: `IMU` with its instance, and another message.
    fn log() -> Vec<u8> {
        let mut b = Vec::new();
        let mut fmt = |kind: u8, length: u8, name: &str, letters: &str, labels: &str| {
            let padded = |t: &str, n: usize| [t.as_bytes(), &vec![0; n - t.len()]].concat();
            b.extend([HEAD[0], HEAD[1], FMT, kind, length]);
            b.extend([padded(name, 4), padded(letters, 16), padded(labels, 64)].concat());
        };
        fmt(FMT, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns");
        fmt(60, 54, "IMU", "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz");
        fmt(61, 15, "ATT", "Qcc", "TimeUS,Roll,Pitch");
        for k in 0..40u64 {
            for imu in 0..2u8 {
                let gain = if imu == 0 { 1.0 } else { 100.0 };
                b.extend([HEAD[0], HEAD[1], 60]);
                b.extend((65_000_000 + 40_000 * k).to_le_bytes());
                b.push(imu);
                for v in [0.001 * gain, -0.002 * gain, 0.003 * gain, 0.0, 0.0, -9.8f32] {
                    b.extend(v.to_le_bytes());
                }
                b.extend([0; 8]);
                b.extend((41.5 + k as f32 * 0.25).to_le_bytes());
                b.extend([1, 1, 0xE8, 3, 0xE8, 3]);
            }
            b.extend([HEAD[0], HEAD[1], 61]);
            b.extend([0; 12]);
        }
        b
    }

    fn map() -> Map {
        Map::built_in("ardupilot").expect("there")
    }

    fn import(bytes: &[u8], name: &str) -> anyhow::Result<crate::recording::Recording> {
        let path = std::env::temp_dir().join(format!("hrg-dataflash-{}-{name}.bin", std::process::id()));
        std::fs::write(&path, bytes).expect("written");
        crate::recording::import::read(&path, &map())
    }

    #[test]
    fn one_imu_of_the_log_is_read() {
        let r = import(&log(), "good").expect("fits");
        assert_eq!((r.time_s.len(), r.time_s[1], r.frequency_hz[0][2]), (40, 65.04, 42.0));
        assert!((r.rate_dph[1][7] + f64::from(0.002f32) * 206_264.806_247).abs() < 1e-6);
        assert_eq!(r.notes, ["IMU 0 is taken; the file also has 1: --imu 1 takes that one"]);
        let mut second = map();
        second.table.instance = 1;
        let t = read(&log(), &second).expect("fits");
        assert!(t.column(&second.rate["y"].column).is_some_and(|y| (y[7] + 0.2).abs() < 1e-6));
        second.table.instance = 2;
        let e = read(&log(), &second).expect_err("no third").0;
        assert!(e.contains("no IMU 2; it has 0 and 1"), "{e}");
        // Bytes that were lost in the middle, and a power loss at the end.
        let mut bytes = log();
        bytes.drain(1000..1010);
        bytes.truncate(bytes.len() - 20);
        let r = import(&bytes, "cut").expect("the rest is there");
        assert!((37..40).contains(&r.time_s.len()), "{}", r.time_s.len());
        assert!(r.notes.iter().any(|n| n.contains("belong to no message")), "{:?}", r.notes);
        assert!(r.notes.iter().any(|n| n.contains("ends within a message")), "{:?}", r.notes);
    }

    #[test]
    fn missing_columns_are_reported_with_those_present() {
        let mut other = map();
        other.table.topic = Some(crate::recording::import::map::Names::One("IMT".into()));
        let e = read(&log(), &other).expect_err("no IMT").0;
        assert!(e.contains("no message IMT; it has ATT and IMU"), "{e}");
        other.table.topic = Some(crate::recording::import::map::Names::One("ATT".into()));
        let e = read(&log(), &other).expect_err("no gyro").0;
        assert!(e.contains("[rate] x, \"GyrX\"") && e.contains("\"Pitch\""), "{e}");
    }

    /// A log as before ArduPilot 4.0: a message for each IMU, and no column for its number.
    #[test]
    fn imus_with_messages_of_their_own() {
        let mut b = Vec::new();
        for (kind, name) in [(60u8, "IMU"), (61, "IMU2")] {
            let padded = |t: &str, n: usize| [t.as_bytes(), &vec![0; n - t.len()]].concat();
            b.extend([HEAD[0], HEAD[1], FMT, kind, 27]);
            b.extend([padded(name, 4), padded("Qffff", 16), padded("TimeUS,GyrX,GyrY,GyrZ,Temp", 64)].concat());
        }
        for k in 0..30u64 {
            for (kind, rate) in [(60u8, 0.5f32), (61, 0.25)] {
                b.extend([HEAD[0], HEAD[1], kind]);
                b.extend((1_000_000 + 20_000 * k).to_le_bytes());
                [rate, rate, rate, 30.0].iter().for_each(|v| b.extend(v.to_le_bytes()));
            }
        }
        for (instance, rate) in [(0, 0.5), (1, 0.25)] {
            let mut map = map();
            map.table.instance = instance;
            let t = read(&b, &map).expect("fits");
            assert!(t.rows() == 30 && t.column(&map.rate["x"].column).is_some_and(|v| v[3] == rate));
            assert!(t.notes[0].contains(&format!("IMU {instance} is taken")), "{:?}", t.notes);
        }
    }

    /// ArduPilot's log of its own calibration: rows of the accelerometers and of another IMU are left out.
    #[test]
    fn its_own_temperature_calibration_is_read() {
        let padded = |t: &str, n: usize| [t.as_bytes(), &vec![0; n - t.len()]].concat();
        let mut b = vec![HEAD[0], HEAD[1], FMT, 70, 33];
        b.extend([padded("TCLR", 4), padded("QBBffffI", 16), padded("TimeUS,I,SType,Temp,X,Y,Z,NSamp", 64)].concat());
        for k in 0..40u64 {
            for (imu, kind) in [(0u8, 0u8), (0, 1), (1, 1)] {
                b.extend([HEAD[0], HEAD[1], 70]);
                b.extend((1_000_000 * k).to_le_bytes());
                b.extend([imu, kind]);
                let rate = 0.001 * f32::from(kind) * (1.0 + f32::from(imu));
                [20.0 + 0.5 * k as f32, rate, -rate, 0.0].iter().for_each(|v| b.extend(v.to_le_bytes()));
                b.extend(1000u32.to_le_bytes());
            }
        }
        let map = Map::built_in("ardupilot-tcal").expect("there");
        let t = read(&b, &map).expect("fits");
        assert!(t.rows() == 40 && t.column(&map.rate["x"].column).is_some_and(|v| (v[9] - 0.001).abs() < 1e-9));
        assert!(t.column(&map.temperature["all"].column).is_some_and(|v| v[9] == 24.5));
    }
}
