//! Text of a file in the encoding that its program writes.

use crate::error::BadInput;
use encoding_rs::{Encoding, UTF_16BE, UTF_16LE, UTF_8, WINDOWS_1252};
use std::borrow::Cow;

/// The text, and a note where its encoding was guessed. `label`: the encoding, as a map names it.
///
/// # Errors
/// A label that is none; bytes that are no text of that encoding.
pub fn decode<'b>(bytes: &'b [u8], label: Option<&str>) -> Result<(Cow<'b, str>, Option<String>), BadInput> {
    let stated = label.map(known).transpose()?;
    if let Some((encoding, mark)) = Encoding::for_bom(bytes) {
        return Ok((encoding.decode_without_bom_handling(&bytes[mark..]).0, None));
    }
    let guessed = || match () {
        () if std::str::from_utf8(bytes).is_ok() && !bytes.contains(&0) => (UTF_8, None),
        () => wide(bytes).map_or((WINDOWS_1252, Some("Windows-1252 (Latin-1)")), |wide| (wide, Some("UTF-16"))),
    };
    let (encoding, name) = stated.map_or_else(guessed, |e| (e, None));
    let (text, broken) = encoding.decode_without_bom_handling(bytes);
    if broken {
        return Err(BadInput(format!("the file is no text in {}", encoding.name())));
    }
    if memchr::memchr(0, text.as_bytes()).is_some() {
        return Err(BadInput::new("the file is no text: it holds zero bytes"));
    }
    let note = name.map(|n| format!("the text is not UTF-8: read as {n}"));
    Ok((text, note))
}

fn known(label: &str) -> Result<&'static Encoding, BadInput> {
    Encoding::for_label(label.as_bytes()).ok_or_else(|| {
        BadInput(format!("\"{label}\" is no encoding; there are utf-8, utf-16le, utf-16be, windows-1252, latin1 and others of the WHATWG list"))
    })
}

/// UTF-16 where every second byte is zero, as it is of ASCII.
fn wide(bytes: &[u8]) -> Option<&'static Encoding> {
    let zeros = |odd: usize| bytes.iter().take(2000).skip(odd).step_by(2).filter(|b| **b == 0).count();
    let least = bytes.len().min(2000) / 4;
    match () {
        () if zeros(1) > least => Some(UTF_16LE),
        () if zeros(0) > least => Some(UTF_16BE),
        () => None,
    }
}

/// `true` for the beginning of a text whose line feed is no byte of its own.
///
/// # Errors
/// A label that is no encoding.
pub fn has_wide_characters(begin: &[u8], label: Option<&str>) -> Result<bool, BadInput> {
    let stated = label.map(known).transpose()?;
    let marked = Encoding::for_bom(begin).map(|(encoding, _)| encoding);
    let encoding = marked.or(stated).or_else(|| wide(begin));
    Ok(encoding.is_some_and(|e| e == UTF_16LE || e == UTF_16BE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encodings_of_measuring_programs_are_read() {
        let text = "Zeit;T [°C]\n1;20,5\n";
        let utf_16 = |order: fn(u16) -> [u8; 2]| text.encode_utf16().flat_map(order).collect::<Vec<u8>>();
        let latin: Vec<u8> = text.chars().map(|c| c as u8).collect();
        let marked: Vec<u8> = [0xFF, 0xFE].into_iter().chain(utf_16(u16::to_le_bytes)).collect();
        for (bytes, noted) in [
            (text.as_bytes().to_vec(), None),
            (["\u{feff}", text].concat().into_bytes(), None),
            (latin.clone(), Some("Windows-1252")),
            (utf_16(u16::to_le_bytes), Some("UTF-16")),
            (utf_16(u16::to_be_bytes), Some("UTF-16")),
            (marked, None),
        ] {
            let (read, note) = decode(&bytes, None).expect("a text");
            assert_eq!(read, text);
            assert_eq!(note.is_some(), noted.is_some(), "{note:?}");
            assert!(noted.is_none_or(|s| note.is_some_and(|n| n.contains(s))));
        }
        assert_eq!(decode(&latin, Some("latin1")).expect("a text"), (text.into(), None));
        assert!(decode(&latin, Some("utf-8")).is_err() && decode(&latin, Some("morse")).is_err());
        assert!(decode(&[0x89, 0x50, 0, 0, 0, 0xFF], None).is_err());
    }
}
