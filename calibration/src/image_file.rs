//! The calibration file: one text file (TOML) that says what the binary block holds, with units, and turns into it
//! and back without loss. The checksum is that of the block, so a number changed by hand is noticed.

use crate::{BadInput, AXIS_NAMES};
use hrg_core::bias::four_parameter::FourParameter;
use hrg_core::bias::Coefficients;
use hrg_core::bias::TERMS;
use hrg_core::calibration::layouts::{Channel, MODELS};
use hrg_core::calibration::{Axis, Calibration, EffectTerm, ImageError, Uncertainty, DIRECTIONS};
use hrg_core::effects::{by_id, EffectId, MAX_OUTPUTS, MAX_PARAMETERS};
use hrg_core::half::Half;
use hrg_core::schema::{Field, Format, Layout, Number};
use hrg_core::AXES;
use serde::ser::{SerializeMap, SerializeSeq};
use serde::{Serialize, Serializer};
use std::path::Path;
use toml::{Table, Value};

/// Version of the file.
const VERSION: u32 = 1;

/// Why a text is no calibration.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FileError {
    /// It is not TOML, or another TOML.
    #[error("this is not a calibration file: {0}")]
    NotOne(String),
    /// It is of another version.
    #[error("the calibration file is of version {0}, this program reads version {VERSION}")]
    Version(String),
    /// The directions of an uncertainty are too many, or not as long as the regressors.
    #[error("{place}: uncertainty_directions_dph must be at most {most} rows of {width} numbers")]
    Directions {
        /// Where.
        place: String,
        /// Most rows.
        most: usize,
        /// Numbers of a row.
        width: usize,
    },
    /// Something is not there.
    #[error("{place} lacks {name}")]
    Missing {
        /// Where.
        place: String,
        /// What.
        name: String,
    },
    /// A value of another kind, or of another number of values.
    #[error("{place}: {name} cannot be {given}")]
    Wrong {
        /// Where.
        place: String,
        /// What.
        name: &'static str,
        /// As it stands there.
        given: String,
    },
    /// A row of another length.
    #[error("{place}: {name} must be {count} numbers")]
    Row {
        /// Where.
        place: String,
        /// What.
        name: String,
        /// How many it must have.
        count: usize,
    },
    /// A checksum that is none.
    #[error("{name} \"{text}\" is not a hexadecimal number")]
    NotHexadecimal {
        /// What.
        name: String,
        /// As it stands there.
        text: String,
    },
    /// No bias model, or several.
    #[error("{0} must have one bias model: bias_dph, or bias_cooling_dph with bias_heating_dph, or four_parameter_dph, bias_of_frequency_dph or network_dph")]
    OneModel(String),
    /// An effect that this program does not have.
    #[error("effect \"{0}\" is not known to this program")]
    UnknownEffect(String),
    /// An effect with another number of gains than it has regressors.
    #[error("effect {effect}: axis {axis} needs {count} gains")]
    Gains {
        /// The effect.
        effect: String,
        /// The axis.
        axis: &'static str,
        /// How many it needs.
        count: usize,
    },
    /// More effects than an image has room for.
    #[error("the calibration file has more effects than a block can hold")]
    TooManyEffects,
    /// What it says is impossible.
    #[error("the calibration file cannot be used: {0}")]
    Unusable(ImageError),
    /// Changed by hand, or damaged.
    #[error("the calibration file's checksum is {stated:08x}, its content gives {content:08x}: it was changed by hand or damaged; make it anew, or set block_crc32 if the change is meant")]
    Checksum {
        /// As it stands there.
        stated: u32,
        /// That of the content.
        content: u32,
    },
}

/// Names that files of older programs have.
const FORMER: [(&str, &str); 1] = [("scale_factor_dph_per_code", "rate_scale_dph_per_code")];

/// What the centre and scale of a thermometer are called where it is a sensor.
const SENSOR: [(&str, &str); 2] =
    [("frequency_centre_hz", "sensor_centre_c"), ("frequency_scale_hz", "sensor_scale_c")];

/// Lines that the file begins with.
const HEAD: &str = "\
# Calibration of an HRG unit. corrected = raw - bias.
# bias = k0 + k1 u + k2 u^2 + k3 r + k4 r^2 + k5 u r, u = (T - t_ref_c) / t_scale_c, r = dT/dt in C per minute,
# plus gain times regressor of each effect. T = c0 + c1 v + c2 v^2 + c3 v^3, v = (f - centre) / scale.
# block_crc32 is the checksum of the binary block: a number changed by hand no longer matches.
";

/// A value of the file, in the order in which it is written. Singles stay singles: they are written with no more digits than they
/// have.
enum Item {
    Number(Number),
    Truth(bool),
    Text(String),
    Row(Vec<Item>),
    Table(Vec<(String, Item)>),
}

impl Serialize for Item {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Number(Number::Whole(v)) => s.serialize_u32(*v),
            Self::Number(Number::Single(v)) => s.serialize_f32(*v),
            Self::Number(Number::Double(v)) => s.serialize_f64(*v),
            Self::Truth(v) => s.serialize_bool(*v),
            Self::Text(v) => s.serialize_str(v),
            Self::Row(items) => {
                let mut row = s.serialize_seq(Some(items.len()))?;
                items.iter().try_for_each(|i| row.serialize_element(i))?;
                row.end()
            }
            Self::Table(entries) => {
                let mut table = s.serialize_map(Some(entries.len()))?;
                entries.iter().try_for_each(|(name, item)| table.serialize_entry(name, item))?;
                table.end()
            }
        }
    }
}

fn singles(values: &[f32]) -> Item {
    Item::Row(values.iter().map(|v| Item::Number(Number::Single(*v))).collect())
}

/// The fields of a part of the image, by their names.
fn entries(part: &impl Layout) -> Vec<(String, Item)> {
    fields_of(part).map(|(at, field)| (field.name.to_string(), item(part, at, field))).collect()
}

fn fields_of<L: Layout>(_: &L) -> impl Iterator<Item = (usize, &'static Field)> {
    L::FIELDS.iter().enumerate()
}

fn item<L: Layout>(part: &L, at: usize, field: &Field) -> Item {
    let numbers: Vec<Number> = (0..field.count).filter_map(|k| part.number(at, k)).collect();
    let whole = |n: &Number| if let Number::Whole(v) = n { *v } else { 0 };
    match (field.format, field.row) {
        (Format::Byte, _) => {
            let bytes: Vec<u8> = numbers.iter().map(|n| whole(n) as u8).take_while(|b| *b != 0).collect();
            Item::Text(String::from_utf8_lossy(&bytes).into_owned())
        }
        (Format::Bool, 0) => Item::Truth(numbers.first().is_some_and(|n| whole(n) != 0)),
        (Format::U32, 0) if is_checksum(field.name) => Item::Text(format!("{:08x}", numbers.first().map_or(0, whole))),
        (_, 0) => Item::Number(numbers.first().copied().unwrap_or(Number::Whole(0))),
        (_, row) => {
            let mut rows: Vec<Item> =
                numbers.chunks(row).map(|r| Item::Row(r.iter().map(|n| Item::Number(*n)).collect())).collect();
            if rows.len() == 1 {
                rows.remove(0)
            } else {
                Item::Row(rows)
            }
        }
    }
}

/// Checksums are written in hexadecimal.
fn is_checksum(name: &str) -> bool {
    name.ends_with("_crc32")
}

fn renamed(entries: Vec<(String, Item)>, names: &[(&str, &str)]) -> Vec<(String, Item)> {
    let new = |name: String| names.iter().find(|(from, _)| *from == name).map_or(name, |(_, to)| (*to).to_string());
    entries.into_iter().map(|(name, item)| (new(name), item)).collect()
}

/// The names of the models' fields, as [`MODELS`] has them.
fn model_entries(c: &Coefficients) -> Vec<(String, Item)> {
    let names: Vec<&str> = MODELS.iter().filter(|m| m.0 == c.kind()).flat_map(|m| m.1).map(|f| f.name).collect();
    let rows: Vec<Item> = match c {
        Coefficients::FourParameter(m) => return vec![(FOUR_PARAMETER.to_string(), Item::Table(entries(m)))],
        Coefficients::One(k) => vec![singles(k)],
        Coefficients::CoolingHeating(cooling, heating) => vec![singles(cooling), singles(heating)],
        Coefficients::Direct(k) => vec![singles(k)],
        Coefficients::Network(k) => vec![singles(k)],
    };
    names.into_iter().map(String::from).zip(rows).collect()
}

/// The table of the four-parameter model.
const FOUR_PARAMETER: &str = "four_parameter_dph";

fn axis_item(a: &Axis) -> Item {
    let names: &[(&str, &str)] = if a.curve.is_of_sensor() { &SENSOR } else { &[] };
    let mut out = renamed(entries(&a.curve), names);
    let channel = entries(&Channel::of(a));
    // The ranges stand together.
    let (scale, ranges): (Vec<_>, Vec<_>) = channel.into_iter().partition(|(n, _)| n == "scale_factor_dph_per_code");
    out.extend(ranges);
    out.extend(scale);
    out.extend(model_entries(&a.coefficients));
    out.extend(entries(a));
    out.extend(uncertainty_entries(&a.uncertainty));
    Item::Table(tables_last(out))
}

/// TOML wants what is not a table before what is one.
fn tables_last(entries: Vec<(String, Item)>) -> Vec<(String, Item)> {
    let (tables, mut out): (Vec<_>, Vec<_>) = entries.into_iter().partition(|(_, i)| matches!(i, Item::Table(_)));
    out.extend(tables);
    out
}

fn effect_item(e: &EffectTerm) -> Option<Item> {
    let facts = by_id(e.id)?;
    let by_axis = |values: &[[f32; MAX_OUTPUTS]; AXES]| {
        Item::Table(
            AXIS_NAMES.iter().zip(values).map(|(n, v)| ((*n).to_string(), singles(&v[..facts.outputs]))).collect(),
        )
    };
    let parameters = facts.parameters.iter().zip(e.parameters);
    let mut out: Vec<(String, Item)> = vec![("name".into(), Item::Text(facts.name.into()))];
    if e.start != 0.0 {
        out.push((START.into(), Item::Number(Number::Single(e.start))));
    }
    out.extend(vec![
        (
            "parameters".into(),
            Item::Table(parameters.map(|(n, v)| ((*n).to_string(), Item::Number(Number::Single(v)))).collect()),
        ),
        ("gain_dph".into(), by_axis(&e.gains)),
        ("gain_std_dph".into(), by_axis(&e.gain_std)),
    ]);
    if e.directions.iter().flatten().flatten().any(|g| *g != Half::ZERO) {
        let of = |a: usize| {
            Item::Row(e.directions.iter().map(|d| singles(&d[a].map(Half::value)[..facts.outputs])).collect())
        };
        let each = AXIS_NAMES.iter().enumerate().map(|(a, n)| ((*n).to_string(), of(a))).collect();
        out.push((DIRECTIONS_KEY.into(), Item::Table(each)));
    }
    Some(Item::Table(out))
}

/// The file's text.
#[must_use]
pub fn to_text(c: &Calibration) -> String {
    let mut file = vec![("hrg_calibration".to_string(), Item::Number(Number::Whole(VERSION)))];
    file.extend(entries(c));
    file.push(("block_crc32".into(), Item::Text(format!("{:08x}", c.checksum()))));
    file.push(("scaling".into(), Item::Table(entries(&c.scaling))));
    let axes = c.axes.iter().zip(AXIS_NAMES).map(|(a, n)| (n.to_string(), axis_item(a))).collect();
    file.push(("axis".into(), Item::Table(axes)));
    let effects: Vec<Item> = c.effects.iter().filter_map(effect_item).collect();
    if !effects.is_empty() {
        file.push(("effect".into(), Item::Row(effects)));
    }
    let body = toml::to_string(&Item::Table(file)).unwrap_or_else(|e| format!("# cannot be written: {e}\n"));
    format!("{HEAD}{body}")
}

/// A value by its name, or by one that older files have.
fn value<'a>(table: &'a Table, name: &str) -> Option<&'a Value> {
    let other = FORMER.iter().chain(&SENSOR).filter(|(today, _)| *today == name);
    table.get(name).or_else(|| other.filter_map(|(_, n)| table.get(*n)).next())
}

/// The numbers of a value, rows after each other; `None` where something else is among them.
fn numbers(value: &Value) -> Option<Vec<Number>> {
    Some(match value {
        Value::Integer(v) => vec![Number::Whole(u32::try_from(*v).ok()?)],
        Value::Float(v) => vec![Number::Double(*v)],
        Value::Boolean(v) => vec![Number::Whole((*v).into())],
        Value::Array(items) => items.iter().map(numbers).collect::<Option<Vec<_>>>()?.concat(),
        _ => return None,
    })
}

/// Reads the fields of a part from the table that has them.
fn fill<L: Layout>(part: &mut L, table: &Table, place: &str) -> Result<(), FileError> {
    for (at, field) in L::FIELDS.iter().enumerate() {
        let given = value(table, field.name).ok_or_else(|| {
            let sensor = SENSOR.iter().find(|(today, _)| *today == field.name);
            let or = sensor.map_or(String::new(), |(_, other)| format!(" (for a sensor {other})"));
            FileError::Missing { place: place.into(), name: format!("{}{or}", field.name) }
        })?;
        let wrong = || FileError::Wrong { place: place.into(), name: field.name, given: given.to_string() };
        let numbers = match given {
            Value::String(text) if is_checksum(field.name) => vec![Number::Whole(hexadecimal(text, field.name)?)],
            Value::String(text) if field.format == Format::Byte => {
                let bytes = text.bytes().filter(u8::is_ascii_graphic).chain(std::iter::repeat(0));
                bytes.take(field.count).map(|b| Number::Whole(b.into())).collect()
            }
            other => numbers(other).ok_or_else(wrong)?,
        };
        let all_set = numbers.iter().enumerate().all(|(k, n)| k < field.count && part.set_number(at, k, *n));
        if numbers.len() != field.count || !all_set {
            return Err(wrong());
        }
    }
    Ok(())
}

fn hexadecimal(text: &str, what: &str) -> Result<u32, FileError> {
    u32::from_str_radix(text, 16).map_err(|_| FileError::NotHexadecimal { name: what.into(), text: text.into() })
}

fn single(n: Number) -> f32 {
    match n {
        Number::Whole(v) => v as f32,
        Number::Single(v) => v,
        Number::Double(v) => v as f32,
    }
}

/// A row of singles of exactly so many numbers.
fn row<const N: usize>(table: &Table, name: &str, place: &str) -> Result<Option<[f32; N]>, FileError> {
    let Some(given) = table.get(name) else { return Ok(None) };
    let values: Vec<f32> = numbers(given).unwrap_or_default().into_iter().map(single).collect();
    let Ok(row) = values.try_into() else {
        return Err(FileError::Row { place: place.into(), name: name.into(), count: N });
    };
    Ok(Some(row))
}

fn read_model(table: &Table, place: &str) -> Result<Coefficients, FileError> {
    let [one, cooling, heating, direct, network] =
        ["bias_dph", "bias_cooling_dph", "bias_heating_dph", "bias_of_frequency_dph", "network_dph"];
    let two_sets = row(table, cooling, place)?.zip(row(table, heating, place)?);
    let four = match table.get(FOUR_PARAMETER).and_then(Value::as_table) {
        Some(t) => {
            let mut m = FourParameter::default();
            fill(&mut m, t, &format!("{place}, {FOUR_PARAMETER},"))?;
            Some(m)
        }
        None => None,
    };
    let models = [
        row(table, one, place)?.map(Coefficients::One),
        two_sets.map(|(c, h)| Coefficients::CoolingHeating(c, h)),
        four.map(Coefficients::FourParameter),
        row(table, direct, place)?.map(Coefficients::Direct),
        row(table, network, place)?.map(Coefficients::Network),
    ];
    let mut given = models.into_iter().flatten();
    match (given.next(), given.next()) {
        (Some(model), None) => Ok(model),
        _ => Err(FileError::OneModel(place.into())),
    }
}

/// At most so many rows of so many singles each; none where nothing is given.
fn rows(given: Option<&Value>, most: usize, width: usize, place: &str) -> Result<Vec<Vec<f32>>, FileError> {
    let Some(given) = given.and_then(Value::as_array) else { return Ok(Vec::new()) };
    let rows: Vec<Vec<f32>> =
        given.iter().map(|r| numbers(r).unwrap_or_default().into_iter().map(single).collect()).collect();
    if rows.len() > most || rows.iter().any(|r: &Vec<f32>| r.len() != width) {
        return Err(FileError::Directions { place: place.to_string(), most, width });
    }
    Ok(rows)
}

/// What states how uncertain the bias is.
const REST: &str = "uncertainty_rest_dph2";
/// The directions of that uncertainty.
const DIRECTIONS_KEY: &str = "uncertainty_directions_dph";
/// Where an effect stands when the unit begins.
const START: &str = "start";

fn uncertainty_entries(u: &Uncertainty) -> Vec<(String, Item)> {
    if *u == Uncertainty::default() {
        return Vec::new();
    }
    vec![
        (REST.into(), Item::Number(Number::Single(u.rest_dph2))),
        (DIRECTIONS_KEY.into(), Item::Row(u.baseline.iter().map(|d| singles(d)).collect())),
    ]
}

fn read_uncertainty(table: &Table, place: &str) -> Result<Uncertainty, FileError> {
    let mut u = Uncertainty::default();
    if let Some(rest) = table.get(REST).and_then(numbers).filter(|v| v.len() == 1) {
        u.rest_dph2 = single(rest[0]);
    }
    for (to, from) in u.baseline.iter_mut().zip(rows(table.get(DIRECTIONS_KEY), DIRECTIONS, TERMS, place)?) {
        to.copy_from_slice(&from);
    }
    Ok(u)
}

fn read_axis(axis: &mut Axis, table: &Table, place: &str) -> Result<(), FileError> {
    fill(&mut axis.curve, table, place)?;
    let mut channel = Channel::default();
    fill(&mut channel, table, place)?;
    channel.store(axis);
    axis.coefficients = read_model(table, place)?;
    axis.uncertainty = read_uncertainty(table, place)?;
    fill(axis, table, place)
}

fn read_effect(table: &Table) -> Result<EffectTerm, FileError> {
    let name = table.get("name").and_then(Value::as_str).unwrap_or("");
    let facts = EffectId::by_name(name).map(EffectId::facts).ok_or_else(|| FileError::UnknownEffect(name.into()))?;
    let place = format!("effect {name}");
    let mut term = EffectTerm::new(facts.id, [0.0; MAX_PARAMETERS]);
    let empty = Table::new();
    let part = |key: &str| table.get(key).and_then(Value::as_table).unwrap_or(&empty);
    for (to, parameter) in term.parameters.iter_mut().zip(facts.parameters) {
        let given = part("parameters").get(*parameter).and_then(numbers).filter(|v| v.len() == 1);
        let given = given
            .ok_or_else(|| FileError::Missing { place: place.clone(), name: format!("the parameter {parameter}") })?;
        *to = single(given[0]);
    }
    if let Some(start) = table.get(START).and_then(numbers).filter(|v| v.len() == 1) {
        term.start = single(start[0]);
    }
    for (a, n) in AXIS_NAMES.iter().enumerate() {
        for (k, row) in rows(part(DIRECTIONS_KEY).get(*n), DIRECTIONS, facts.outputs, &place)?.iter().enumerate() {
            term.directions[k][a].iter_mut().zip(row).for_each(|(to, v)| *to = Half::of(*v));
        }
        for (to, key) in [(&mut term.gains[a], "gain_dph"), (&mut term.gain_std[a], "gain_std_dph")] {
            let given = part(key).get(*n).and_then(numbers).filter(|v| v.len() == facts.outputs);
            let given = given.ok_or_else(|| FileError::Gains { effect: name.into(), axis: n, count: facts.outputs })?;
            to.iter_mut().zip(given).for_each(|(to, n)| *to = single(n));
        }
    }
    Ok(term)
}

/// Reads the file's text.
///
/// # Errors
/// One sentence.
pub fn from_text(text: &str) -> Result<Calibration, FileError> {
    let not_one = |why: &str| FileError::NotOne(why.replace('\n', " "));
    let file: Table = toml::from_str(text).map_err(|e| not_one(&e.to_string()))?;
    let version = file.get("hrg_calibration").ok_or_else(|| not_one("hrg_calibration is missing"))?;
    if *version != Value::Integer(VERSION.into()) {
        return Err(FileError::Version(version.to_string()));
    }
    let table = |within: &Table, name: &str, place: &str| {
        let found = within.get(name).and_then(Value::as_table).cloned();
        found.ok_or_else(|| FileError::Missing { place: "the calibration file".into(), name: format!("[{place}]") })
    };
    let mut c = Calibration::uncalibrated();
    fill(&mut c, &file, "the calibration file")?;
    fill(&mut c.scaling, &table(&file, "scaling", "scaling")?, "[scaling]")?;
    let axes = table(&file, "axis", "axis")?;
    for (axis, n) in c.axes.iter_mut().zip(AXIS_NAMES) {
        let place = format!("axis.{n}");
        read_axis(axis, &table(&axes, n, &place)?, &format!("[{place}]"))?;
    }
    let effects = file.get("effect").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    for e in effects.iter().filter_map(Value::as_table) {
        c.effects.push(read_effect(e)?).map_err(|_| FileError::TooManyEffects)?;
    }
    c.check().map_err(FileError::Unusable)?;
    let stated = file.get("block_crc32").and_then(Value::as_str);
    let stated = stated
        .ok_or_else(|| FileError::Missing { place: "the calibration file".into(), name: "block_crc32".into() })?;
    let stated = hexadecimal(stated, "block_crc32")?;
    if stated != c.checksum() {
        return Err(FileError::Checksum { stated, content: c.checksum() });
    }
    Ok(c)
}

/// Reads a calibration, text or binary.
///
/// # Errors
/// One sentence with the path.
pub fn load(path: &Path) -> anyhow::Result<Calibration> {
    let bytes = crate::read_file(path, crate::MOST_CALIBRATION, false)?;
    let here = |e: String| BadInput::new(format!("{}: {e}", path.display()));
    if bytes.starts_with(&hrg_core::calibration::MAGIC) {
        return Ok(Calibration::from_bytes(&bytes).map_err(|e: ImageError| here(e.to_string()))?);
    }
    let text = std::str::from_utf8(&bytes).map_err(|_| here("it is neither a calibration file nor a block".into()))?;
    Ok(from_text(text).map_err(|e| here(e.to_string()))?)
}

/// Writes a calibration: binary where the path ends in `.bin`, else text.
///
/// # Errors
/// Where the file cannot be written.
pub fn save(path: &Path, c: &Calibration) -> anyhow::Result<()> {
    if path.extension().is_some_and(|e| e == "bin") {
        let bytes = c.to_bytes().ok_or_else(|| anyhow::anyhow!("the calibration does not fit a block"))?;
        return crate::write_file(path, &bytes);
    }
    crate::write_file(path, to_text(c).as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_change_by_hand_is_noticed() {
        let text = to_text(&Calibration::uncalibrated());
        assert!(from_text(&text).is_ok());
        let changed = text.replace("t_ref_c = 10.0", "t_ref_c = 11.0");
        assert_ne!(text, changed);
        assert!(from_text(&changed).expect_err("noticed").to_string().contains("checksum"));
        assert!(matches!(from_text("a = 1"), Err(FileError::NotOne(_))));
    }

    #[test]
    fn a_file_with_former_names_reads_as_it_did() {
        let c = Calibration::uncalibrated();
        let text = to_text(&c);
        let former = text.replace("scale_factor_dph_per_code", "rate_scale_dph_per_code");
        assert_ne!(text, former);
        assert_eq!(from_text(&former).expect("readable"), c);
    }

    #[test]
    fn what_is_missing_or_wrong_is_named_with_its_place() {
        let text = to_text(&Calibration::uncalibrated());
        for (from, to, says) in [
            ("t_scale_c", "t_size_c", "[scaling] lacks t_scale_c"),
            ("frequency_scale_hz", "scale_hz", "[axis.x] lacks frequency_scale_hz (for a sensor sensor_scale_c)"),
            ("calibrated = false", "calibrated = 7.5", "the calibration file: calibrated cannot be 7.5"),
            ("[axis.y]", "[axis.q]", "the calibration file lacks [axis.y]"),
            ("bias_dph = [", "bias_of_frequency_dph = [", "[axis.x]: bias_of_frequency_dph must be 7 numbers"),
            ("bias_dph = [", "no_bias_dph = [", "[axis.x] must have one bias model: bias_dph, or"),
            ("hrg_calibration = 1", "hrg_calibration = 9", "is of version 9, this program reads version 1"),
        ] {
            let changed = text.replace(from, to);
            assert_ne!(text, changed, "{from}");
            let e = from_text(&changed).expect_err(says).to_string();
            assert!(e.contains(says), "{e}");
        }
    }

    proptest! {
        #[test]
        fn text_and_block_are_the_same_calibration(k in proptest::array::uniform6(-1e3f32..1e3), g in -9f32..9.0, f0 in 4e3f64..5e3) {
            let mut c = Calibration::uncalibrated();
            c.set_unit_name("HRG-7");
            c.axes[0].coefficients = Coefficients::One(k);
            c.axes[1].coefficients = Coefficients::CoolingHeating(k, [g; 6]);
            c.axes[2].curve.frequency_centre_hz = f0;
            c.axes[1].curve = crate::thermometer::curve::sensor_curve(g.into(), f64::from(g) + 40.0);
            let rest = if g < -3.0 {
                Coefficients::Network(std::array::from_fn(|j| k[j % 6] + j as f32))
            } else if g < 3.0 {
                Coefficients::Direct(std::array::from_fn(|j| k[j % 6]))
            } else {
                let m = FourParameter { constant_cooling_heating_low_high: [g; 5], breakpoint_c: g, origin_c: k[0] };
                Coefficients::FourParameter(m)
            };
            c.axes[2].coefficients = rest;
            let mut e = EffectTerm::new(7, [0.0; 2]);
            e.start = -1.0;
            e.directions[1][0][0] = Half::of(g);
            c.axes[2].uncertainty.rest_dph2 = g.abs();
            c.axes[2].uncertainty.baseline[1][3] = -g;
            e.gains[1][1] = g;
            c.effects.push(e).expect("room");
            let again = from_text(&to_text(&c)).expect("readable");
            prop_assert_eq!(again.to_bytes(), c.to_bytes());
        }
    }
}
