//! The tables in the docs are those of the lists, and Python reads by them what the project writes.

use hrg_core::calibration::layouts::Header;
use hrg_core::calibration::Calibration;
use hrg_core::link::layouts::MESSAGES;
use hrg_core::link::{Housekeeping, Message};
use hrg_core::schema::{size, Field, Layout};
use hrg_study::formats::{python, tables};
use std::process::Command;

#[test]
fn the_page_has_the_tables_as_they_are_printed() {
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/formats.md");
    let page = std::fs::read_to_string(page).expect("the page");
    for (name, table) in tables() {
        let marked = format!("<!-- {name}: begin -->\n{table}<!-- {name}: end -->");
        assert!(page.contains(&marked), "cargo xtask formats writes the table {name} anew");
    }
}

/// Values that Python reads from bytes by the format of fields, or `None` if there is no Python.
fn by_python(fields: &[Field], bytes: &[u8]) -> Option<Vec<String>> {
    let hex: String = bytes.iter().map(|b| format!("{b:02x}")).collect();
    let program =
        "import struct, sys\nprint('\\n'.join(map(repr, struct.unpack(sys.argv[1], bytes.fromhex(sys.argv[2])))))";
    let output = Command::new("python3").args(["-c", program, &python(fields), &hex]).output().ok()?;
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8_lossy(&output.stdout).lines().map(String::from).collect())
}

/// A message's bytes between its leading bytes and its checksum.
fn fields_of(message: &Message, lead: usize) -> Vec<u8> {
    let frame = message.encode();
    let mut plain = [0; 512];
    let n = cobs::decode(&frame[..frame.len() - 1], &mut plain).expect("COBS").frame_size();
    plain[lead..n - 4].to_vec()
}

#[test]
fn python_reads_a_frame_by_its_format() {
    let h = Housekeeping {
        step: 77,
        time_ms: 78_050,
        frequency_hz: [4898.626, 4890.5, 4702.25],
        bias_dph: [0.5, -2.0, 3.25],
        samples: 1000,
        missing: [1, 0, 3],
        sequence: 12,
        mode: 1,
        ..Housekeeping::default()
    };
    let bytes = fields_of(&Message::Housekeeping(h), 1);
    let table = MESSAGES.iter().find(|m| m.name == "housekeeping").expect("in the list");
    assert_eq!((bytes.len(), table.lead), (size(table.fields), &[2][..]));
    let Some(values) = by_python(table.fields, &bytes) else { return };
    let at = |name: &str| -> usize {
        let place = table.fields.iter().position(|f| f.name == name).expect("a field");
        table.fields[..place].iter().map(|f| f.count).sum()
    };
    assert_eq!((values[at("step")].as_str(), values[at("time_ms")].as_str()), ("77", "78050"));
    assert_eq!(values[at("frequency_hz")..at("frequency_hz") + 3], ["4898.626", "4890.5", "4702.25"]);
    assert_eq!(values[at("bias_dph")..at("bias_dph") + 3], ["0.5", "-2.0", "3.25"]);
    assert_eq!((values[at("samples")].as_str(), values[at("missing") + 2].as_str()), ("1000", "3"));
    assert_eq!((values[at("sequence")].as_str(), values[at("mode")].as_str()), ("12", "1"));
    let last = table.fields.last().expect("fields");
    assert_eq!(values.len(), at(last.name) + last.count);
}

#[test]
fn python_reads_the_head_of_an_image_by_its_format() {
    let mut c = Calibration::uncalibrated();
    c.set_unit_name("HRG-7");
    (c.created_unix_s, c.sequence, c.data_crc32) = (1_700_000_000, 3, 0xDEAD_BEEF);
    let bytes = c.to_bytes().expect("fits");
    let fields = [Header::FIELDS, Calibration::FIELDS, hrg_core::bias::Scaling::FIELDS].concat();
    assert_eq!(size(Header::FIELDS), 8);
    let Some(values) = by_python(&fields, &bytes[..size(&fields)]) else { return };
    // (`4B` are four numbers, `16s` is one text.)
    let magic: Vec<String> = b"HRGC".iter().map(ToString::to_string).collect();
    assert_eq!(values[..4], magic);
    assert_eq!((&values[4..6], values[6].clone()), (&["1".to_string(), "0".to_string()][..], bytes.len().to_string()));
    assert!(values[7].starts_with("b'HRG-7\\x00"), "{}", values[7]);
    assert_eq!(values[8..12], ["1700000000", "3", "3735928559", "False"]);
    assert_eq!(values[12..14], [format!("{:?}", c.scaling.t_ref_c), format!("{:?}", c.scaling.t_scale_c)]);
}

#[test]
fn each_message_is_as_long_as_its_fields() {
    let frames = [
        (Message::Housekeeping(Housekeeping::default()), "housekeeping"),
        (Message::SetDecimation(5), "set decimation"),
        (Message::Identify, "identify"),
        (Message::Maintain(hrg_core::maintenance::Command::Begin(7)), "maintain: begin"),
        (Message::Maintain(hrg_core::maintenance::Command::Close), "maintain: close"),
    ];
    for (message, name) in frames {
        let table = MESSAGES.iter().find(|m| m.name == name).expect("in the list");
        assert_eq!(fields_of(&message, table.lead.len()).len(), size(table.fields), "{name}");
    }
}
