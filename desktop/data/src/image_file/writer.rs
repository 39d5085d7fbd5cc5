//! Writes a calibration as text.

use super::{
    is_checksum, ACCELEROMETER, ACCELEROMETERS, DIRECTIONS_KEY, FOUR_PARAMETER, INPUT, QUANTITY, REST, SENSOR, START,
    VERSION,
};
use crate::axes::AXIS_NAMES;
use hrg_core::accelerometers::Accelerometers;
use hrg_core::bias::Coefficients;
use hrg_core::calibration::layouts::MODELS;
use hrg_core::calibration::{Axis, Calibration, EffectTerm, Uncertainty};
use hrg_core::effects::{by_id, MAX_OUTPUTS};
use hrg_core::half::Half;
use hrg_core::inputs::{self, Input};
use hrg_core::rate_factors::RateAxis;
use hrg_core::schema::{Field, Format, Layout, Number};
use hrg_core::specific_force::Accelerometer;
use hrg_core::visited::Visited;
use hrg_core::AXES;
use serde::ser::{SerializeMap, SerializeSeq};
use serde::{Serialize, Serializer};

/// Lines that the file begins with.
const HEAD: &str = "\
# Calibration of an HRG unit. corrected = M S (raw - bias); without scale_correction_ppm, M and S are one.
# bias = k0 + k1 u + k2 u^2 + k3 r + k4 r^2 + k5 u r, u = (T - t_ref_c) / t_scale_c, r = dT/dt in C per minute,
# plus gain times regressor of each effect. T = c0 + c1 v + c2 v^2 + c3 v^3, v = (f - centre) / scale.
# S_i = 1 + 1e-6 (c0 + c1 u + c2 u^2 + c3 u^3 + c4 r); M_ij = 1e-6 (m0 + m1 u) beside a diagonal of ones, in the order of the axes.
# uncertainty_rest_dph2 and the directions give the standard uncertainty of the bias. Learnt from one train run, it does not hold the
# constant that changes with each power-on.
# visited_levels: for each eighth of the temperatures of the fit, the lowest (bits 0 to 3) and highest (4 to 7) of 16 levels of its ramps
# that were visited there; beyond them the unit flags extrapolated, and unvisited_dph2 comes on top of the variance; beyond the ranges it
# counts by the square of the distance in eighths of the range.
# input: what the effects need beside the frequencies; they count it from its reference and within its range.
# block_crc32 is the checksum of the binary image: a number changed by hand no longer matches.
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

fn axis_item(a: &Axis, rates: Option<&RateAxis>) -> Item {
    let names: &[(&str, &str)] = if a.curve.is_of_sensor() { &SENSOR } else { &[] };
    let mut out = renamed(entries(&a.curve), names);
    out.extend(model_entries(&a.coefficients));
    out.extend(entries(a));
    out.extend(uncertainty_entries(&a.uncertainty));
    if a.visited != Visited::default() {
        out.extend(entries(&a.visited));
    }
    out.extend(rates.map_or_else(Vec::new, entries));
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

/// An input, by the name of its column.
fn input_item(i: &Input) -> Option<Item> {
    let name = *inputs::NAMES.get(usize::from(i.quantity))?;
    let others = entries(i).into_iter().filter(|(key, _)| key != QUANTITY);
    Some(Item::Table(std::iter::once(("name".to_string(), Item::Text(name.into()))).chain(others).collect()))
}

fn uncertainty_entries(u: &Uncertainty) -> Vec<(String, Item)> {
    if *u == Uncertainty::default() {
        return Vec::new();
    }
    vec![
        (REST.into(), Item::Number(Number::Single(u.rest_dph2))),
        (DIRECTIONS_KEY.into(), Item::Row(u.baseline.iter().map(|d| singles(d)).collect())),
    ]
}

/// The file's text.
#[must_use]
pub fn to_text(c: &Calibration) -> String {
    let mut file = vec![("hrg_calibration".to_string(), Item::Number(Number::Whole(VERSION)))];
    file.extend(entries(c));
    file.push(("block_crc32".into(), Item::Text(format!("{:08x}", c.checksum()))));
    file.push(("scaling".into(), Item::Table(entries(&c.scaling))));
    let one = |(k, n): (usize, &&str)| ((*n).to_string(), axis_item(&c.axes[k], c.rates.as_ref().map(|r| &r[k])));
    let axes = AXIS_NAMES.iter().enumerate().map(one).collect();
    file.push(("axis".into(), Item::Table(axes)));
    let effects: Vec<Item> = c.effects.iter().filter_map(effect_item).collect();
    if !effects.is_empty() {
        file.push(("effect".into(), Item::Row(effects)));
    }
    let inputs: Vec<Item> = c.inputs.iter().filter_map(input_item).collect();
    if !inputs.is_empty() {
        file.push((INPUT.into(), Item::Row(inputs)));
    }
    if c.accelerometers != Accelerometers::IDEAL {
        file.push((ACCELEROMETERS.into(), Item::Table(entries(&c.accelerometers))));
    }
    if let Some(all) = &c.specific_force {
        let one = |(n, a): (&&str, &Accelerometer)| {
            ((*n).to_string(), Item::Table(entries(&a.bias).into_iter().chain(entries(&a.errors)).collect()))
        };
        file.push((ACCELEROMETER.into(), Item::Table(AXIS_NAMES.iter().zip(all).map(one).collect())));
    }
    let body = toml::to_string(&Item::Table(file)).unwrap_or_else(|e| format!("# cannot be written: {e}\n"));
    format!("{HEAD}{body}")
}
