//! Recordings as Parquet tables, as pandas writes and reads them. The crate parquet reads and writes the files; here is only
//! which column is what.
//!
//! A recording keeps its names of columns, and its metadata lie where pandas keeps `DataFrame.attrs`: so
//! `pandas.read_parquet("run.parquet").attrs` has them, and a frame with attributes that pandas writes is a recording.

use super::columns::{self, Role};
use super::metadata::Lines;
use crate::error::BadInput;
use parquet::basic::{Compression, ConvertedType, LogicalType, Repetition, TimeUnit, Type as Physical};
use parquet::column::reader::ColumnReader;
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int32Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{ColumnDescriptor, Type};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

/// First bytes of a Parquet file.
pub const MAGIC: [u8; 4] = *b"PAR1";

/// Key under which pandas keeps `DataFrame.attrs`, as JSON.
const ATTRIBUTES: &str = "PANDAS_ATTRS";

/// Prefix of pandas' names for the columns of an index that has no name.
const INDEX: &str = "__index_level_";

/// Rows that are read or written at once.
const ROWS: usize = 1 << 16;

/// The cells of a column.
#[derive(Debug, Clone, PartialEq)]
pub enum Cells {
    /// Numbers; NaN where missing. Of times since 1970 (`datetime64`): how many of them make a second.
    Numbers(Vec<f64>, Option<f64>),
    /// Texts; empty where missing.
    Texts(Vec<String>),
}

impl Cells {
    /// Number of cells.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Numbers(v, _) => v.len(),
            Self::Texts(v) => v.len(),
        }
    }

    /// `true` if there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A table as it stands in a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Contents {
    /// Metadata, by their keys.
    pub meta: BTreeMap<String, String>,
    /// Columns of numbers and texts, by their names in order.
    pub columns: Vec<(String, Cells)>,
    /// Columns of other kinds (lists, structures, decimals): by name.
    pub others: Vec<String>,
}

/// `true` if a path asks for Parquet.
#[must_use]
pub fn is_wanted(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("parquet"))
}

fn cannot(e: &ParquetError) -> BadInput {
    BadInput(format!(
        "cannot be read as Parquet: {e}; write it again, compressed with snappy, zstd, gzip or not at all"
    ))
}

/// Values of a column of a row group, by a function to what they mean; `missing` where there is none.
fn values<T: DataType, V: Clone>(
    reader: &mut parquet::column::reader::ColumnReaderImpl<T>,
    optional: bool,
    missing: &V,
    mut value: impl FnMut(&T::T) -> V,
    to: &mut Vec<V>,
) -> Result<(), ParquetError> {
    loop {
        let (mut levels, mut read) = (Vec::new(), Vec::new());
        let (records, _, _) = reader.read_records(ROWS, Some(&mut levels), None, &mut read)?;
        if records == 0 {
            return Ok(());
        }
        if optional {
            let mut next = read.iter();
            for level in levels {
                to.push(if level > 0 {
                    next.next().map_or_else(|| missing.clone(), &mut value)
                } else {
                    missing.clone()
                });
            }
        } else {
            to.extend(read.iter().map(&mut value));
        }
    }
}

/// Number of units of a column of times in a second.
fn per_second(of: &ColumnDescriptor) -> Option<f64> {
    match (of.logical_type_ref(), of.converted_type()) {
        (Some(LogicalType::Timestamp(t)), _) => Some(match t.unit {
            TimeUnit::MILLIS => 1e3,
            TimeUnit::MICROS => 1e6,
            TimeUnit::NANOS => 1e9,
        }),
        (_, ConvertedType::TIMESTAMP_MILLIS) => Some(1e3),
        (_, ConvertedType::TIMESTAMP_MICROS) => Some(1e6),
        _ => None,
    }
}

/// An empty column for what a descriptor says; `None` for what is no plain number or text.
fn empty(of: &ColumnDescriptor) -> Option<Cells> {
    if of.max_rep_level() > 0 || of.max_def_level() > 1 || of.path().parts().len() > 1 {
        return None;
    }
    let decimal = of.converted_type() == ConvertedType::DECIMAL;
    match of.physical_type() {
        _ if decimal => None,
        Physical::BYTE_ARRAY => Some(Cells::Texts(Vec::new())),
        Physical::FIXED_LEN_BYTE_ARRAY | Physical::INT96 => None,
        _ => Some(Cells::Numbers(Vec::new(), per_second(of))),
    }
}

fn read_group(reader: ColumnReader, of: &ColumnDescriptor, cells: &mut Cells) -> Result<(), ParquetError> {
    let gap = f64::NAN;
    let optional = of.max_def_level() > 0;
    use ConvertedType as C;
    let unsigned = matches!(of.converted_type(), C::UINT_8 | C::UINT_16 | C::UINT_32 | C::UINT_64);
    match (cells, reader) {
        (Cells::Numbers(to, _), ColumnReader::BoolColumnReader(mut r)) => {
            values(&mut r, optional, &gap, |v| f64::from(u8::from(*v)), to)
        }
        (Cells::Numbers(to, _), ColumnReader::Int32ColumnReader(mut r)) => {
            let value = |v: &i32| if unsigned { f64::from(*v as u32) } else { f64::from(*v) };
            values(&mut r, optional, &gap, value, to)
        }
        (Cells::Numbers(to, _), ColumnReader::Int64ColumnReader(mut r)) => {
            let value = |v: &i64| if unsigned { *v as u64 as f64 } else { *v as f64 };
            values(&mut r, optional, &gap, value, to)
        }
        (Cells::Numbers(to, _), ColumnReader::FloatColumnReader(mut r)) => {
            values(&mut r, optional, &gap, |v| f64::from(*v), to)
        }
        (Cells::Numbers(to, _), ColumnReader::DoubleColumnReader(mut r)) => values(&mut r, optional, &gap, |v| *v, to),
        (Cells::Texts(to), ColumnReader::ByteArrayColumnReader(mut r)) => {
            let text = |v: &ByteArray| String::from_utf8_lossy(v.data()).into_owned();
            values(&mut r, optional, &String::new(), text, to)
        }
        _ => Ok(()),
    }
}

/// The metadata of a file: those that pandas keeps.
fn metadata(pairs: Option<&Vec<KeyValue>>) -> Result<BTreeMap<String, String>, BadInput> {
    let text = pairs.into_iter().flatten().find(|p| p.key == ATTRIBUTES).and_then(|p| p.value.as_deref());
    let Some(text) = text else { return Ok(BTreeMap::new()) };
    let attributes: BTreeMap<String, serde_json::Value> = serde_json::from_str(text)
        .map_err(|e| BadInput(format!("the attributes of the table ({ATTRIBUTES}) are no JSON object: {e}")))?;
    let plain = |v: serde_json::Value| match v {
        serde_json::Value::String(s) => s,
        other => other.to_string(),
    };
    Ok(attributes.into_iter().map(|(k, v)| (k, plain(v))).collect())
}

/// Reads a table.
///
/// # Errors
/// One sentence: what cannot be read.
pub fn read(bytes: Vec<u8>) -> Result<Contents, BadInput> {
    let file = SerializedFileReader::new(bytes::Bytes::from(bytes)).map_err(|e| cannot(&e))?;
    let about = file.metadata().file_metadata();
    let meta = metadata(about.key_value_metadata())?;
    let schema = about.schema_descr_ptr();
    let mut columns: Vec<(usize, String, Cells)> = Vec::new();
    let mut others = Vec::new();
    for (k, of) in schema.columns().iter().enumerate() {
        match empty(of) {
            Some(cells) => columns.push((k, of.name().to_string(), cells)),
            None => others.push(of.path().string()),
        }
    }
    for group in 0..file.num_row_groups() {
        let group = file.get_row_group(group).map_err(|e| cannot(&e))?;
        for (k, _, cells) in &mut columns {
            let reader = group.get_column_reader(*k).map_err(|e| cannot(&e))?;
            read_group(reader, &schema.column(*k), cells).map_err(|e| cannot(&e))?;
        }
    }
    let columns = columns.into_iter().map(|(_, name, cells)| (name, cells)).collect();
    Ok(Contents { meta, columns, others })
}

/// The text of a recording that lies in a Parquet file.
///
/// # Errors
/// One sentence: what cannot be read, or cannot stand in a recording.
pub fn to_csv(bytes: Vec<u8>) -> Result<String, BadInput> {
    let table = read(bytes)?;
    let mut s = String::new();
    for (k, v) in &table.meta {
        let _ = writeln!(s, "# {k}: {}", v.replace(['\n', '\r'], " "));
    }
    // pandas' own count of rows is no column of a recording.
    let columns: Vec<&(String, Cells)> = table.columns.iter().filter(|(n, _)| !n.starts_with(INDEX)).collect();
    for (name, cells) in &columns {
        if columns::find(name).is_some() && matches!(cells, Cells::Texts(_)) {
            return Err(BadInput(format!("the column {name} holds texts; save it as numbers")));
        }
    }
    if columns.is_empty() {
        return Err(BadInput::new("the table has no column of numbers"));
    }
    let names: Vec<&str> = columns.iter().map(|(n, _)| n.as_str()).collect();
    if let Some(name) = names.iter().find(|n| n.contains([',', '\n', '"'])) {
        return Err(BadInput(format!("a column is called \"{name}\"; rename it without commas, quotes and line ends")));
    }
    let _ = writeln!(s, "{}", names.join(","));
    let rows = columns.iter().map(|(_, c)| c.len()).max().unwrap_or(0);
    for k in 0..rows {
        for (at, (_, cells)) in columns.iter().enumerate() {
            if at > 0 {
                s.push(',');
            }
            if let Cells::Numbers(v, _) = cells {
                let _ = v.get(k).filter(|v| v.is_finite()).map_or(Ok(()), |v| write!(s, "{v}"));
            }
        }
        s.push('\n');
    }
    Ok(s)
}

/// Columns of the text of a recording as this program writes it: metadata, names, values.
type Parts<'t> = (Vec<(String, String)>, Vec<&'t str>, Vec<Vec<Option<f64>>>);

fn parts(csv: &str) -> anyhow::Result<Parts<'_>> {
    let (mut lines, mut names, mut values) = (Lines::default(), Vec::new(), Vec::new());
    for (k, line) in csv.lines().enumerate() {
        if let Some(meta) = line.strip_prefix('#') {
            lines.take(k + 1, meta)?;
        } else if names.is_empty() {
            names = line.split(',').collect();
            values = vec![Vec::new(); names.len()];
        } else {
            let mut cells = line.split(',');
            for column in &mut values {
                column.push(cells.next().and_then(|c| c.parse().ok()));
            }
        }
    }
    Ok((lines.entries, names, values))
}

/// The Parquet file of a recording's text, as this program writes it.
///
/// # Errors
/// None that a recording of this program gives.
pub fn from_csv(csv: &str) -> anyhow::Result<Vec<u8>> {
    let (meta, names, values) = parts(csv)?;
    let bits = |name: &str| columns::find(name).is_some_and(|(c, _)| c.role == Role::Status);
    let fields = names
        .iter()
        .map(|name| {
            let physical = if bits(name) { Physical::INT32 } else { Physical::DOUBLE };
            Type::primitive_type_builder(name, physical).with_repetition(Repetition::OPTIONAL).build().map(Arc::new)
        })
        .collect::<Result<Vec<_>, _>>()?;
    let schema = Arc::new(Type::group_type_builder("schema").with_fields(fields).build()?);
    let meta: serde_json::Map<String, serde_json::Value> = meta.into_iter().map(|(k, v)| (k, v.into())).collect();
    let attributes = KeyValue::new(ATTRIBUTES.to_string(), serde_json::to_string(&meta)?);
    let properties = WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .set_key_value_metadata(Some(vec![attributes]))
        .build();
    let mut writer = SerializedFileWriter::new(Vec::new(), schema, Arc::new(properties))?;
    let mut group = writer.next_row_group()?;
    for (name, column) in names.iter().zip(&values) {
        let Some(mut out) = group.next_column()? else { break };
        for part in column.chunks(ROWS) {
            let levels: Vec<i16> = part.iter().map(|v| i16::from(v.is_some())).collect();
            let there = part.iter().copied().flatten();
            if bits(name) {
                let there: Vec<i32> = there.map(|v| v as i32).collect();
                out.typed::<Int32Type>().write_batch(&there, Some(&levels), None)?;
            } else {
                let there: Vec<f64> = there.collect();
                out.typed::<DoubleType>().write_batch(&there, Some(&levels), None)?;
            }
        }
        out.close()?;
    }
    group.close()?;
    Ok(writer.into_inner()?)
}

/// A table as Parquet: numbers (NaN where missing) and texts (empty where missing).
///
/// # Errors
/// None in practice: the file is made in memory.
pub fn write_table(columns: &[(String, Cells)]) -> anyhow::Result<Vec<u8>> {
    let fields = columns
        .iter()
        .map(|(name, cells)| {
            let of = |physical| Type::primitive_type_builder(name, physical).with_repetition(Repetition::OPTIONAL);
            let field = match cells {
                Cells::Numbers(..) => of(Physical::DOUBLE),
                Cells::Texts(_) => of(Physical::BYTE_ARRAY).with_logical_type(Some(LogicalType::String)),
            };
            field.build().map(Arc::new)
        })
        .collect::<Result<Vec<_>, _>>()?;
    let schema = Arc::new(Type::group_type_builder("schema").with_fields(fields).build()?);
    let properties = WriterProperties::builder().set_compression(Compression::SNAPPY).build();
    let mut writer = SerializedFileWriter::new(Vec::new(), schema, Arc::new(properties))?;
    let mut group = writer.next_row_group()?;
    for (_, cells) in columns {
        let Some(mut out) = group.next_column()? else { break };
        match cells {
            Cells::Numbers(values, _) => {
                let levels: Vec<i16> = values.iter().map(|v| i16::from(v.is_finite())).collect();
                let there: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
                out.typed::<DoubleType>().write_batch(&there, Some(&levels), None)?;
            }
            Cells::Texts(texts) => {
                let levels: Vec<i16> = texts.iter().map(|t| i16::from(!t.is_empty())).collect();
                let there: Vec<ByteArray> =
                    texts.iter().filter(|t| !t.is_empty()).map(|t| ByteArray::from(t.as_str())).collect();
                out.typed::<ByteArrayType>().write_batch(&there, Some(&levels), None)?;
            }
        }
        out.close()?;
    }
    group.close()?;
    Ok(writer.into_inner()?)
}

/// Reads the text of a recording: a text file as it is, packed or not; a Parquet file as text.
///
/// # Errors
/// A sentence with the path.
pub fn read_text(path: &Path) -> Result<Vec<u8>, BadInput> {
    if begins_as_parquet(path) {
        let bytes = crate::files::read_file(path, crate::files::MOST_RECORDING, false)?;
        return to_csv(bytes).map(String::into_bytes).map_err(|e| BadInput(format!("{}: {e}", path.display())));
    }
    crate::files::read_file(path, crate::files::MOST_RECORDING, true).map_err(|e| match path.exists() {
        true => e,
        false => BadInput(format!("{e} (hrg simulate --out FILE makes a recording to try with)")),
    })
}

/// `true` if a file begins as Parquet does; `false` for a file that cannot be read.
#[must_use]
pub fn begins_as_parquet(path: &Path) -> bool {
    crate::files::begins_with(path, MAGIC)
}

/// Writes the text of a recording: as Parquet if the path ends so, else as text.
///
/// # Errors
/// If the folder cannot be written.
pub fn write_text(path: &Path, csv: &str) -> anyhow::Result<()> {
    if is_wanted(path) {
        crate::output::write_file(path, &from_csv(csv)?)
    } else {
        crate::output::write_file(path, csv.as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::super::samples::rows;
    use super::super::Recording;
    use super::*;

    fn both_ways(csv: &str) -> String {
        to_csv(from_csv(csv).expect("written")).expect("readable")
    }

    #[test]
    fn a_recording_comes_back_with_its_metadata_and_gaps() {
        let text = rows(200_000).replace("# unit: A", "# unit: A\n# latitude_deg: 30\n# axes: x=north y=east z=down");
        let text = text.replacen("\n5,4900.003,", "\n5,,", 1).replace("rate_z_dph\n", "rate_z_dph,case_x_c\n");
        let text: String = text
            .lines()
            .map(|l| match l.as_bytes()[0] {
                b'#' | b't' => format!("{l}\n"),
                _ => format!("{l},24.0625\n"),
            })
            .collect();
        let (mut a, mut b) = (
            Recording::parse(text.as_bytes()).expect("readable"),
            Recording::parse(both_ways(&text).as_bytes()).expect("readable"),
        );
        for r in [&mut a, &mut b] {
            r.meta.sort();
            r.notes.clear();
        }
        // (NaN is not itself: compared as text.)
        assert_eq!(a.to_csv(), b.to_csv());
        assert!(b.frequency_hz[0][5].is_nan() && b.meta("axes") == Some("x=north y=east z=down"));
    }

    #[test]
    fn what_a_unit_sent_comes_back_to_the_last_bit() {
        let text = "# rates: corrected\n# unit: A\ntime_s,fx_hz,rate_x_dph,bias_x_dph,status_x,status_unit\n\
                    1,4878.848000000001,0.1,,3,0\n2,4878.8,-0.30000001,1e-7,65535,1\n";
        let bytes = from_csv(text).expect("written");
        let table = read(bytes.clone()).expect("readable");
        assert_eq!(table.columns[4], ("status_x".into(), Cells::Numbers(vec![3.0, 65535.0], None)));
        let back = to_csv(bytes).expect("readable");
        let rows = |t: &str| t.lines().skip(2).map(|l| l.split(',').map(|c| c.parse::<f64>().ok()).collect()).collect();
        let (a, b): (Vec<Vec<_>>, Vec<Vec<_>>) = (rows(text), rows(&back));
        assert_eq!(a, b);
    }

    #[test]
    fn what_is_no_table_is_refused() {
        let whole = from_csv(&rows(50)).expect("written");
        for bad in [MAGIC.to_vec(), whole[..whole.len() / 2].to_vec(), [&whole[..40], &[0; 400][..], &MAGIC].concat()] {
            let e = to_csv(bad).expect_err("refused").0;
            assert!(e.starts_with("cannot be read as Parquet: "), "{e}");
        }
    }
}
