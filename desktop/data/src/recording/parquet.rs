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
use parquet::file::reader::{ChunkReader, FileReader, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{ColumnDescriptor, Type};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{Read, Write as _};
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

/// Rows of a batch.
const BATCH: usize = 1 << 19;

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

/// The next values of a column of a row group, by a function to what they mean; `missing` where there is none.
fn values<T: DataType, V: Clone>(
    reader: &mut parquet::column::reader::ColumnReaderImpl<T>,
    optional: bool,
    missing: &V,
    mut value: impl FnMut(&T::T) -> V,
    to: &mut Vec<V>,
) -> Result<(), ParquetError> {
    let most = to.len() + BATCH;
    while to.len() < most {
        let (mut levels, mut read) = (Vec::new(), Vec::new());
        let (records, _, _) = reader.read_records(ROWS.min(most - to.len()), Some(&mut levels), None, &mut read)?;
        if records == 0 {
            break;
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
    Ok(())
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

fn read_next(reader: &mut ColumnReader, of: &ColumnDescriptor, cells: &mut Cells) -> Result<(), ParquetError> {
    let gap = f64::NAN;
    let optional = of.max_def_level() > 0;
    use ConvertedType as C;
    let unsigned = matches!(of.converted_type(), C::UINT_8 | C::UINT_16 | C::UINT_32 | C::UINT_64);
    match (cells, reader) {
        (Cells::Numbers(to, _), ColumnReader::BoolColumnReader(r)) => {
            values(r, optional, &gap, |v| f64::from(u8::from(*v)), to)
        }
        (Cells::Numbers(to, _), ColumnReader::Int32ColumnReader(r)) => {
            let value = |v: &i32| if unsigned { f64::from(*v as u32) } else { f64::from(*v) };
            values(r, optional, &gap, value, to)
        }
        (Cells::Numbers(to, _), ColumnReader::Int64ColumnReader(r)) => {
            let value = |v: &i64| if unsigned { *v as u64 as f64 } else { *v as f64 };
            values(r, optional, &gap, value, to)
        }
        (Cells::Numbers(to, _), ColumnReader::FloatColumnReader(r)) => values(r, optional, &gap, |v| f64::from(*v), to),
        (Cells::Numbers(to, _), ColumnReader::DoubleColumnReader(r)) => values(r, optional, &gap, |v| *v, to),
        (Cells::Texts(to), ColumnReader::ByteArrayColumnReader(r)) => {
            let text = |v: &ByteArray| String::from_utf8_lossy(v.data()).into_owned();
            values(r, optional, &String::new(), text, to)
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

/// A table, read batch by batch.
pub struct Batches<R: ChunkReader + 'static> {
    file: SerializedFileReader<R>,
    /// Metadata, by their keys.
    pub meta: BTreeMap<String, String>,
    /// Columns of numbers and texts: place in the file, name, nothing yet.
    columns: Vec<(usize, String, Cells)>,
    /// Columns of other kinds (lists, structures, decimals): by name.
    pub others: Vec<String>,
    /// Number of the next row group, and the readers of the columns of the one before.
    group: usize,
    readers: Vec<ColumnReader>,
}

impl Batches<std::fs::File> {
    /// Of a file.
    ///
    /// # Errors
    /// One sentence: a file that cannot be read.
    pub fn open(path: &Path) -> Result<Self, BadInput> {
        let file = std::fs::File::open(path)
            .map_err(|e| BadInput(format!("cannot read {}: {e}; check the path", path.display())))?;
        Self::new(file)
    }
}

impl<R: ChunkReader + 'static> Batches<R> {
    fn new(from: R) -> Result<Self, BadInput> {
        let file = SerializedFileReader::new(from).map_err(|e| cannot(&e))?;
        let about = file.metadata().file_metadata();
        let meta = metadata(about.key_value_metadata())?;
        let schema = about.schema_descr_ptr();
        let (mut columns, mut others) = (Vec::new(), Vec::new());
        for (k, of) in schema.columns().iter().enumerate() {
            match empty(of) {
                Some(cells) => columns.push((k, of.name().to_string(), cells)),
                None => others.push(of.path().string()),
            }
        }
        Ok(Self { file, meta, columns, others, group: 0, readers: Vec::new() })
    }

    /// Number of numbers and texts.
    fn size(&self) -> u64 {
        self.file.metadata().file_metadata().num_rows().max(0) as u64 * self.columns.len() as u64
    }

    /// The columns of the next rows; `None` behind the last.
    ///
    /// # Errors
    /// One sentence: what cannot be read.
    pub fn next_batch(&mut self) -> Result<Option<Vec<(String, Cells)>>, BadInput> {
        let schema = self.file.metadata().file_metadata().schema_descr_ptr();
        loop {
            let mut columns = self.columns.clone();
            for ((k, _, cells), reader) in columns.iter_mut().zip(&mut self.readers) {
                read_next(reader, &schema.column(*k), cells).map_err(|e| cannot(&e))?;
            }
            if columns.iter().any(|(_, _, cells)| !cells.is_empty()) {
                return Ok(Some(columns.into_iter().map(|(_, name, cells)| (name, cells)).collect()));
            }
            if self.group == self.file.num_row_groups() {
                return Ok(None);
            }
            let group = self.file.get_row_group(self.group).map_err(|e| cannot(&e))?;
            let reader = |(k, ..): &(usize, String, Cells)| group.get_column_reader(*k);
            self.readers = self.columns.iter().map(reader).collect::<Result<_, _>>().map_err(|e| cannot(&e))?;
            self.group += 1;
        }
    }
}

/// The text of a recording that lies in a Parquet file.
///
/// # Errors
/// One sentence: what cannot be read, or cannot stand in a recording.
pub fn to_csv(bytes: Vec<u8>) -> Result<String, BadInput> {
    let mut text = String::new();
    Text::new(Batches::new(bytes::Bytes::from(bytes))?)?
        .read_to_string(&mut text)
        .map_err(|e| BadInput(e.to_string()))?;
    Ok(text)
}

/// The text of a recording that lies in a Parquet file, made batch by batch.
pub(super) struct Text<R: ChunkReader + 'static> {
    from: Batches<R>,
    /// Places of the columns among those of a batch.
    places: Vec<usize>,
    /// Made, and not read.
    text: std::io::Cursor<Vec<u8>>,
}

impl Text<std::fs::File> {
    /// Of a file that has more cells than this; `None` for one that has less, and for what cannot be read.
    pub fn of_large(path: &Path, cells: u64) -> Option<Result<Self, BadInput>> {
        Batches::open(path).ok().filter(|b| b.size() > cells).map(Self::new)
    }

    /// Of any file.
    ///
    /// # Errors
    /// A file that cannot be read, or holds no recording.
    pub fn open(path: &Path) -> Result<Self, BadInput> {
        Self::new(Batches::open(path)?)
    }
}

impl<R: ChunkReader + 'static> Text<R> {
    fn new(from: Batches<R>) -> Result<Self, BadInput> {
        let mut text = String::new();
        for (k, v) in &from.meta {
            let _ = writeln!(text, "# {k}: {}", v.replace(['\n', '\r'], " "));
        }
        // pandas' own count of rows is no column of a recording.
        let there = from.columns.iter().enumerate().filter(|(_, (_, n, _))| !n.starts_with(INDEX));
        let columns: Vec<(usize, &str, &Cells)> = there.map(|(at, (_, n, cells))| (at, n.as_str(), cells)).collect();
        for (_, name, cells) in &columns {
            if columns::find(name).is_some() && matches!(cells, Cells::Texts(_)) {
                return Err(BadInput(format!("the column {name} holds texts; save it as numbers")));
            }
        }
        if columns.is_empty() {
            return Err(BadInput::new("the table has no column of numbers"));
        }
        let names: Vec<&str> = columns.iter().map(|(_, n, _)| *n).collect();
        if let Some(name) = names.iter().find(|n| n.contains([',', '\n', '"'])) {
            return Err(BadInput(format!(
                "a column is called \"{name}\"; rename it without commas, quotes and line ends"
            )));
        }
        let _ = writeln!(text, "{}", names.join(","));
        let places = columns.iter().map(|(at, ..)| *at).collect();
        Ok(Self { from, places, text: std::io::Cursor::new(text.into_bytes()) })
    }

    /// The rows of a batch.
    fn rows(&self, batch: &[(String, Cells)]) -> String {
        let mut s = String::new();
        let rows = batch.iter().map(|(_, c)| c.len()).max().unwrap_or(0);
        for k in 0..rows {
            for (n, at) in self.places.iter().enumerate() {
                if n > 0 {
                    s.push(',');
                }
                if let Cells::Numbers(v, _) = &batch[*at].1 {
                    let _ = v.get(k).filter(|v| v.is_finite()).map_or(Ok(()), |v| write!(s, "{v}"));
                }
            }
            s.push('\n');
        }
        s
    }
}

impl<R: ChunkReader + 'static> Read for Text<R> {
    fn read(&mut self, to: &mut [u8]) -> std::io::Result<usize> {
        let n = self.text.read(to)?;
        if n > 0 || to.is_empty() {
            return Ok(n);
        }
        match self.from.next_batch().map_err(std::io::Error::other)? {
            Some(batch) => {
                self.text = std::io::Cursor::new(self.rows(&batch).into_bytes());
                self.text.read(to)
            }
            None => Ok(0),
        }
    }
}

/// A recording's text, written as Parquet part by part.
struct Writer<W: std::io::Write + Send> {
    to: SerializedFileWriter<W>,
    names: Vec<String>,
}

/// `true` for a column of bits.
fn is_bits(name: &str) -> bool {
    columns::find(name).is_some_and(|(c, _)| c.role == Role::Status)
}

impl<W: std::io::Write + Send> Writer<W> {
    /// With the metadata and names of the first part of a text, as this program writes it.
    fn new(to: W, first: &str) -> anyhow::Result<Self> {
        let mut lines = Lines::default();
        let mut names: Vec<String> = Vec::new();
        for (k, line) in first.lines().enumerate() {
            if let Some(meta) = line.strip_prefix('#') {
                lines.take(k + 1, meta)?;
            } else if names.is_empty() {
                names = line.split(',').map(String::from).collect();
            }
        }
        let fields = names
            .iter()
            .map(|name| {
                let physical = if is_bits(name) { Physical::INT32 } else { Physical::DOUBLE };
                Type::primitive_type_builder(name, physical).with_repetition(Repetition::OPTIONAL).build().map(Arc::new)
            })
            .collect::<Result<Vec<_>, _>>()?;
        let schema = Arc::new(Type::group_type_builder("schema").with_fields(fields).build()?);
        let meta: serde_json::Map<String, serde_json::Value> =
            lines.entries.into_iter().map(|(k, v)| (k, v.into())).collect();
        let attributes = KeyValue::new(ATTRIBUTES.to_string(), serde_json::to_string(&meta)?);
        let properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_key_value_metadata(Some(vec![attributes]))
            .build();
        Ok(Self { to: SerializedFileWriter::new(to, schema, Arc::new(properties))?, names })
    }

    /// Adds rows: a group of their own.
    fn add<'t>(&mut self, rows: impl Iterator<Item = &'t str>) -> anyhow::Result<()> {
        let mut values: Vec<Vec<Option<f64>>> = vec![Vec::new(); self.names.len()];
        for line in rows.filter(|l| !l.starts_with('#')) {
            let mut cells = line.split(',');
            for column in &mut values {
                column.push(cells.next().and_then(|c| c.parse().ok()));
            }
        }
        let mut group = self.to.next_row_group()?;
        for (name, column) in self.names.iter().zip(&values) {
            let Some(mut out) = group.next_column()? else { break };
            for part in column.chunks(ROWS) {
                let levels: Vec<i16> = part.iter().map(|v| i16::from(v.is_some())).collect();
                let there = part.iter().copied().flatten();
                if is_bits(name) {
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
        Ok(())
    }
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

/// Writes the text of a recording: as Parquet if the path ends so, else as text, packed by gzip where the path ends in `.gz`.
///
/// # Errors
/// If the folder cannot be written.
pub fn write_text(path: &Path, csv: &str) -> anyhow::Result<()> {
    write_parts(path, |part| part(csv))
}

/// The same of a text that is made part by part; the first one has metadata and names.
///
/// # Errors
/// If the folder cannot be written, and what makes the parts; a file that was there stays as it was.
pub fn write_parts<T>(
    path: &Path,
    make: impl FnOnce(&mut dyn FnMut(&str) -> anyhow::Result<()>) -> anyhow::Result<T>,
) -> anyhow::Result<T> {
    let packed = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gz"));
    crate::output::write_with(path, |out| {
        if is_wanted(path) {
            into(out, make)
        } else if packed {
            let mut out = flate2::write::GzEncoder::new(out, flate2::Compression::default());
            let made = make(&mut |part| Ok(out.write_all(part.as_bytes())?))?;
            out.finish()?;
            Ok(made)
        } else {
            make(&mut |part| Ok(out.write_all(part.as_bytes())?))
        }
    })
}

/// Writes parts as Parquet.
fn into<T>(
    out: impl std::io::Write + Send,
    make: impl FnOnce(&mut dyn FnMut(&str) -> anyhow::Result<()>) -> anyhow::Result<T>,
) -> anyhow::Result<T> {
    let (mut out, mut writer) = (Some(out), None);
    let made = make(&mut |part| {
        if let Some(out) = out.take() {
            let rows = part.lines().skip_while(|l| l.starts_with('#')).skip(1);
            return writer.insert(Writer::new(out, part)?).add(rows);
        }
        writer.as_mut().map_or(Ok(()), |w| w.add(part.lines()))
    })?;
    if let Some(writer) = writer {
        writer.to.close()?;
    }
    Ok(made)
}

/// The Parquet file of a recording's text.
#[cfg(test)]
pub fn from_csv(csv: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    into(&mut bytes, |part| part(csv)).expect("written");
    bytes
}

/// The columns of the first rows of a Parquet file.
#[cfg(test)]
pub fn first_rows(bytes: Vec<u8>) -> Vec<(String, Cells)> {
    let mut batches = Batches::new(bytes::Bytes::from(bytes)).expect("readable");
    batches.next_batch().expect("readable").expect("rows")
}

#[cfg(test)]
mod tests {
    use super::super::samples::rows;
    use super::super::Recording;
    use super::*;

    fn both_ways(csv: &str) -> String {
        to_csv(from_csv(csv)).expect("readable")
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
        let bytes = from_csv(text);
        let table = first_rows(bytes.clone());
        assert_eq!(table[4], ("status_x".into(), Cells::Numbers(vec![3.0, 65535.0], None)));
        let back = to_csv(bytes).expect("readable");
        let rows = |t: &str| t.lines().skip(2).map(|l| l.split(',').map(|c| c.parse::<f64>().ok()).collect()).collect();
        let (a, b): (Vec<Vec<_>>, Vec<Vec<_>>) = (rows(text), rows(&back));
        assert_eq!(a, b);
    }

    #[test]
    fn what_is_no_table_is_refused() {
        let whole = from_csv(&rows(50));
        for bad in [MAGIC.to_vec(), whole[..whole.len() / 2].to_vec(), [&whole[..40], &[0; 400][..], &MAGIC].concat()] {
            let e = to_csv(bad).expect_err("refused").0;
            assert!(e.starts_with("cannot be read as Parquet: "), "{e}");
        }
    }
}
