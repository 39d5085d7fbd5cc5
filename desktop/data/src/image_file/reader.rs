//! Reads the text of a calibration.

use super::{
    is_checksum, FileError, ACCELEROMETER, ACCELEROMETERS, DIRECTIONS_KEY, FOUR_PARAMETER, INPUT, QUANTITY, REST,
    SENSOR, START, VERSION,
};
use crate::axes::AXIS_NAMES;
use crate::recording::columns;
use hrg_core::bias::four_parameter::FourParameter;
use hrg_core::bias::{Coefficients, TERMS};
use hrg_core::calibration::{Axis, Calibration, EffectTerm, Uncertainty, DIRECTIONS};
use hrg_core::effects::{EffectId, MAX_PARAMETERS};
use hrg_core::half::Half;
use hrg_core::inputs::{self, Input};
use hrg_core::rate_factors::RateAxis;
use hrg_core::schema::{Format, Layout, Number};
use hrg_core::specific_force::Accelerometer;
use hrg_core::visited::Visited;
use hrg_core::AXES;
use toml::{Table, Value};

/// A value by its name, or by the one that a sensor's curve has.
fn value<'a>(table: &'a Table, name: &str) -> Option<&'a Value> {
    let other = SENSOR.iter().filter(|(today, _)| *today == name);
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

/// Scale factors and misalignments over temperature: of all axes, or of none.
fn read_rates(axes: &Table) -> Result<Option<[RateAxis; AXES]>, FileError> {
    let table = |n: &str| axes.get(n).and_then(Value::as_table);
    let stated = |t: &Table| RateAxis::FIELDS.iter().any(|f| t.contains_key(f.name));
    if !AXIS_NAMES.iter().any(|n| table(n).is_some_and(stated)) {
        return Ok(None);
    }
    let mut rates = [RateAxis::default(); AXES];
    for (to, n) in rates.iter_mut().zip(AXIS_NAMES) {
        if let Some(table) = table(n) {
            fill(to, table, &format!("[axis.{n}]"))?;
        }
    }
    Ok(Some(rates))
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
    axis.coefficients = read_model(table, place)?;
    axis.uncertainty = read_uncertainty(table, place)?;
    if Visited::FIELDS.iter().any(|f| table.contains_key(f.name)) {
        fill(&mut axis.visited, table, place)?;
    }
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

fn read_input(table: &Table) -> Result<Input, FileError> {
    let name = table.get("name").and_then(Value::as_str).unwrap_or("");
    let number = inputs::number(columns::today(name)).ok_or_else(|| FileError::UnknownInput(name.into()))?;
    let mut table = table.clone();
    table.insert(QUANTITY.into(), Value::Integer(number.into()));
    let mut input = Input::default();
    fill(&mut input, &table, &format!("input {name}"))?;
    Ok(input)
}

/// Reads the file's text.
///
/// # Errors
/// One sentence.
pub fn from_text(text: &str) -> Result<Calibration, FileError> {
    let not_one = |why: &str| FileError::NotOne(why.replace('\n', " "));
    if text.lines().any(|line| line.starts_with("time_s,")) {
        return Err(not_one("it is a recording, which hrg fit makes one from"));
    }
    let file: Table = toml::from_str(text).map_err(|e: toml::de::Error| {
        let before = e.span().and_then(|s| text.get(..s.start)).unwrap_or("");
        not_one(&format!("line {}: {}", before.matches('\n').count() + 1, e.message()))
    })?;
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
    c.rates = read_rates(&axes)?;
    let effects = file.get("effect").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    for e in effects.iter().filter_map(Value::as_table) {
        c.effects.push(read_effect(e)?).map_err(|_| FileError::TooManyEffects)?;
    }
    let inputs = file.get(INPUT).and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    for i in inputs.iter().filter_map(Value::as_table) {
        c.inputs.push(read_input(i)?).map_err(|_| FileError::UnknownInput("more than there are".into()))?;
    }
    if let Some(given) = file.get(ACCELEROMETERS).and_then(Value::as_table) {
        fill(&mut c.accelerometers, given, &format!("[{ACCELEROMETERS}]"))?;
    }
    if let Some(given) = file.get(ACCELEROMETER).and_then(Value::as_table) {
        let mut all = [Accelerometer::default(); AXES];
        for (to, n) in all.iter_mut().zip(AXIS_NAMES) {
            let place = format!("{ACCELEROMETER}.{n}");
            let one = table(given, n, &place)?;
            fill(&mut to.bias, &one, &format!("[{place}]"))?;
            fill(&mut to.errors, &one, &format!("[{place}]"))?;
        }
        c.specific_force = Some(all);
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
