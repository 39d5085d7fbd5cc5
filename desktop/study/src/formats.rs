//! The tables of `docs/formats.md`: columns of recordings from their list, bytes (with formats of Python's `struct`) from the layouts in
//! `hrg_core`.

use hrg_core::accelerometers::Accelerometers;
use hrg_core::calibration::layouts::{EffectHead, Header, MODELS};
use hrg_core::calibration::{Axis, Calibration};
use hrg_core::link::layouts::MESSAGES;
use hrg_core::rate_factors::RateAxis;
use hrg_core::schema::{size, Field, Format, Layout};
use hrg_core::self_test::Check;
use hrg_core::specific_force::AccelerometerBias;
use hrg_core::temperature::TemperatureCurve;
use hrg_data::recording::columns;
use std::fmt::Write as _;

/// The format of Python's `struct` for fields, little-endian.
#[must_use]
pub fn python(fields: &[Field]) -> String {
    fields.iter().fold(String::from("<"), |mut s, f| {
        if f.count > 1 {
            let _ = write!(s, "{}", f.count);
        }
        s.push(f.format.letter());
        s
    })
}

fn kind(f: &Field) -> String {
    let one = match f.format {
        Format::U8 => "u8",
        Format::U16 => "u16",
        Format::U32 => "u32",
        Format::F32 => "f32",
        Format::F64 => "f64",
        Format::Bool => "bool",
        Format::Byte => "byte",
    };
    if f.row == 0 {
        one.into()
    } else if f.row == f.count {
        format!("{one} x {}", f.count)
    } else {
        format!("{one} x {} x {}", f.count / f.row, f.row)
    }
}

/// A table of fields, the first of which lies at `at`.
fn table(fields: &[Field], at: usize) -> String {
    let mut s = String::from("| byte | field | type | meaning |\n|--:|---|---|---|\n");
    let mut at = at;
    for f in fields {
        let _ = writeln!(s, "| {at} | `{}` | {} | {} |", f.name, kind(f), f.meaning);
        at += f.size();
    }
    s
}

fn part(name: &str, fields: &[Field]) -> String {
    format!("\n**{name}**, {} bytes, `{}`\n\n{}", size(fields), python(fields), table(fields, 0))
}

/// Every table, by the name of its marks in the page.
#[must_use]
pub fn tables() -> [(&'static str, String); 3] {
    [("recording", columns::table()), ("image", image()), ("link", link())]
}

/// The tables of an image.
#[must_use]
pub fn image() -> String {
    let mut s = String::from(
        "Little-endian, without gaps: header; identity; scaling; three axes, each of temperature curve, number of the model (u8), \
         model, and own numbers; number of effects (u8); the effects; CRC-32 (ISO-HDLC, u32) of all before it. Bytes count from \
         the beginning of each part; the format behind its name is one of Python's `struct`.\n",
    );
    s += &part("Header", Header::FIELDS);
    s += &part("Identity", Calibration::FIELDS);
    s += &part("Scaling", hrg_core::bias::Scaling::FIELDS);
    s += &part("Temperature curve of an axis", TemperatureCurve::FIELDS);
    for (number, fields) in MODELS {
        s += &part(&format!("Bias model {number}"), fields);
    }
    s += &part("Own numbers of an axis", Axis::FIELDS);
    s += &part("Effect", EffectHead::FIELDS);
    s += "\nBehind that, for each axis: n gains (f32, deg/h per unit of the regressor) and their n standard deviations.\n";
    s += &part("Accelerometers (part 1)", Accelerometers::FIELDS);
    s += &part("Scale factor and misalignment of an axis (part 2: x, y, z)", RateAxis::FIELDS);
    s + &part("Bias of an accelerometer (part 5: x, y, z; behind each the fields of part 2)", AccelerometerBias::FIELDS)
}

/// The tables of the link's messages.
#[must_use]
pub fn link() -> String {
    let mut s = String::from(
        "Little-endian, without gaps; behind the fields of each message lies the CRC-32 (ISO-HDLC, u32) of the leading bytes and the fields.\n\
         The format is one of Python's `struct` for the fields.\n",
    );
    for m in MESSAGES {
        let lead: Vec<String> = m.lead.iter().map(|b| format!("0x{b:02X}")).collect();
        let _ = write!(s, "\n**{}**: begins with {}", m.name, lead.join(", "));
        if m.fields.is_empty() {
            s.push_str("; no fields\n");
        } else {
            let _ =
                write!(s, "; {} bytes, `{}`\n\n{}", size(m.fields), python(m.fields), table(m.fields, m.lead.len()));
        }
    }
    s.push_str(
        "\n**Checks of the built-in test**\n\n| number | name | meaning | unit of its figure |\n|--:|---|---|---|\n",
    );
    for check in Check::ALL {
        let facts = check.facts();
        let _ = writeln!(s, "| {} | {} | {} | {} |", check as u8, facts.name, facts.meaning, facts.unit);
    }
    s
}
