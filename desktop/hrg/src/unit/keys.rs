//! Keys that sign calibrations for firmware that wants it (feature `signed`): Ed25519.
//!
//! A key file holds 64 hexadecimal digits in a line: the private key. Beside it, with `.pub` behind its name, lies the public one, which goes
//! into the firmware.

use anyhow::{Context, Result};
use ed25519_dalek::{Signer, SigningKey};
use hrg_data::error::BadInput;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Digits of a key.
const DIGITS: usize = 64;

fn digits(bytes: &[u8; 32]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

fn bytes(text: &str) -> Option<[u8; 32]> {
    let text = text.trim();
    let all = text.len() == DIGITS && text.bytes().all(|b| b.is_ascii_hexdigit());
    let mut out = [0; 32];
    for (to, k) in out.iter_mut().zip((0..DIGITS).step_by(2)) {
        *to = u8::from_str_radix(text.get(k..k + 2).filter(|_| all)?, 16).ok()?;
    }
    Some(out)
}

/// A file that is not there yet; `private`: nobody but its owner may read it.
fn create(path: &Path, private: bool, line: &str) -> Result<()> {
    let mut options = std::fs::OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    if private {
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    }
    let mut file = options.open(path).map_err(|e| {
        BadInput::new(match e.kind() {
            std::io::ErrorKind::AlreadyExists => {
                format!("{}: is there already; a key is never overwritten", path.display())
            }
            _ => format!("cannot write {}: {e}", path.display()),
        })
    })?;
    file.write_all(format!("{line}\n").as_bytes())
        .and_then(|()| file.sync_all())
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Path of the public half of a key.
fn public_path(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_os_string();
    name.push(".pub");
    name.into()
}

/// Makes a key: the private half goes to `path`, readable for its owner only, the public one beside it. Gives the public one.
///
/// # Errors
/// If one of the two files is there already, or cannot be written; if the system has no random numbers.
pub fn generate(path: &Path) -> Result<String> {
    let mut seed = [0; 32];
    getrandom::fill(&mut seed).map_err(|e| anyhow::anyhow!("the system has no random numbers: {e}"))?;
    let public = digits(&SigningKey::from_bytes(&seed).verifying_key().to_bytes());
    create(path, true, &digits(&seed))?;
    create(&public_path(path), false, &public).inspect_err(|_| drop(std::fs::remove_file(path)))?;
    Ok(public)
}

/// Reads a private key.
///
/// # Errors
/// If the file cannot be read, or holds none.
pub fn load(path: &Path) -> Result<SigningKey> {
    let content = hrg_data::files::read_file(path, 1024, false)?;
    let seed = std::str::from_utf8(&content).ok().and_then(bytes).ok_or_else(|| {
        BadInput::new(format!("{}: this is no key of hrg unit keygen ({DIGITS} hexadecimal digits)", path.display()))
    })?;
    let key = SigningKey::from_bytes(&seed);
    // Of the two files of a key the wrong one is easily taken.
    let public = std::fs::read_to_string(public_path(path)).ok().and_then(|t| bytes(&t));
    anyhow::ensure!(
        public.is_none_or(|p| p == key.verifying_key().to_bytes()),
        BadInput::new(format!("{}: is not the private key of {}", path.display(), public_path(path).display()))
    );
    Ok(key)
}

/// An image with its signature behind it, as it is burnt.
#[must_use]
pub fn sign(image: &[u8], key: &SigningKey) -> Vec<u8> {
    [image, &key.sign(image).to_bytes()].concat()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrg_core::signature::{behind, Key};

    #[test]
    fn a_key_comes_back_and_signs() {
        let folder = std::env::temp_dir().join(format!("hrg-keys-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("made");
        let path = folder.join("k");
        let public = generate(&path).expect("made");
        assert_eq!(std::fs::read_to_string(folder.join("k.pub")).expect("there").trim(), public);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            assert_eq!(std::fs::metadata(&path).expect("there").permissions().mode() & 0o777, 0o600);
        }
        assert!(generate(&path).expect_err("it is there").to_string().contains("never overwritten"));
        let key = load(&path).expect("a key");
        let image = hrg_core::calibration::Calibration::uncalibrated().to_bytes().expect("fits");
        let signed = sign(&image, &key);
        let public = Key::new(bytes(&public).expect("digits"));
        let signature = behind(&signed).expect("signed");
        assert!(public.signed(&signed, signature));
        assert!(!public.signed(&signed, &[1; 64]));
        // The public half is no private key, and says so.
        assert!(load(&folder.join("none")).is_err());
        std::fs::copy(folder.join("k.pub"), folder.join("other")).expect("copied");
        std::fs::copy(folder.join("k.pub"), folder.join("other.pub")).expect("copied");
        assert!(load(&folder.join("other")).expect_err("not it").to_string().contains("is not the private key"));
        std::fs::write(folder.join("short"), "1234").expect("written");
        assert!(load(&folder.join("short")).expect_err("not it").to_string().contains("no key of hrg unit keygen"));
        let _ = std::fs::remove_dir_all(folder);
    }

    #[test]
    fn the_tests_key_is_that_of_rfc_8032() {
        // Section 7.1, test 1: a signature of nothing.
        let key =
            load(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../host-tests/keys/test.key"))).expect("a key");
        assert!(digits(&key.verifying_key().to_bytes()).starts_with("d75a980182b10ab7"));
        assert_eq!(sign(&[], &key)[..8], [0xe5, 0x56, 0x43, 0x00, 0xc3, 0x60, 0xac, 0x72]);
    }
}
