//! The one writer of output files.
//!
//! A regular file, or none, is replaced at once: an interruption leaves the old one. A symbolic link is followed and its target
//! replaced. A device or a pipe is written into, and `-` is standard output.

use crate::error::BadInput;
use anyhow::Context;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Standard output, and the names that Unix has for it.
const STDOUT: [&str; 4] = ["-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"];
/// Links in a row beyond which they are taken for a circle, as Linux does.
const MOST_LINKS: usize = 40;

/// Target of an output.
#[derive(Debug, PartialEq, Eq)]
enum Target {
    /// Standard output.
    Stdout,
    /// A device, a pipe or a socket: opened and written into.
    Stream,
    /// A regular file, there or not, at the end of all links.
    File(PathBuf),
}

/// `true` for the names of standard output.
#[must_use]
pub fn is_standard(path: &Path) -> bool {
    STDOUT.iter().any(|name| path == Path::new(name))
}

impl Target {
    fn of(path: &Path) -> io::Result<Self> {
        if is_standard(path) {
            return Ok(Self::Stdout);
        }
        match fs::metadata(path) {
            // (A folder is refused by the rename, with the system's own words.)
            Ok(found) if !found.is_file() && !found.is_dir() => Ok(Self::Stream),
            Err(e) if e.kind() != io::ErrorKind::NotFound => Err(e),
            _ => end_of_links(path).map(Self::File),
        }
    }
}

/// The path that a chain of symbolic links ends at; it need not be there.
fn end_of_links(path: &Path) -> io::Result<PathBuf> {
    let mut path = path.to_path_buf();
    for _ in 0..MOST_LINKS {
        let Ok(next) = fs::read_link(&path) else { return Ok(path) };
        path = path.parent().map_or(next.clone(), |folder| folder.join(next));
    }
    Err(io::Error::other("too many symbolic links"))
}

/// Writes an output: see the [module](self). `-` is standard output.
///
/// # Errors
/// If the folder is not there, or the place cannot be written; a file that was there stays as it was.
pub fn write_file(path: &Path, content: &[u8]) -> anyhow::Result<()> {
    write_with(path, |out| out.write_all(content).with_context(|| format!("cannot write {}", path.display())))
}

/// The same of an output that is made piece by piece.
///
/// # Errors
/// As [`write_file`] and what makes the pieces; a file that was there stays as it was.
pub fn write_with<T>(
    path: &Path,
    make: impl FnOnce(&mut (dyn Write + Send)) -> anyhow::Result<T>,
) -> anyhow::Result<T> {
    let cannot = || format!("cannot write {}", path.display());
    let through = |out: &mut (dyn Write + Send)| {
        let mut out = io::BufWriter::with_capacity(1 << 20, out);
        let made = make(&mut out)?;
        out.flush().with_context(cannot)?;
        Ok(made)
    };
    match Target::of(path).with_context(cannot)? {
        Target::Stdout => through(&mut io::stdout()),
        Target::Stream => through(&mut OpenOptions::new().write(true).open(path).with_context(cannot)?),
        Target::File(file) => replace(path, &file, through),
    }
}

/// Replaces a regular file: a neighbour is written and is on the disk before it is renamed.
fn replace<T>(
    named: &Path,
    file: &Path,
    make: impl FnOnce(&mut (dyn Write + Send)) -> anyhow::Result<T>,
) -> anyhow::Result<T> {
    let folder = file.parent().filter(|f| !f.as_os_str().is_empty() && !f.exists());
    if let Some(folder) = folder {
        let (named, folder) = (named.display(), folder.display());
        return Err(BadInput(format!(
            "cannot write {named}: there is no folder {folder}; make it, or write elsewhere"
        ))
        .into());
    }
    let cannot = || format!("cannot write {}", named.display());
    let mut name = file.file_name().unwrap_or_default().to_os_string();
    name.push(format!(".{}.part", std::process::id()));
    let part = file.with_file_name(name);
    let write = || {
        let mut out = OpenOptions::new().write(true).create_new(true).open(&part).with_context(cannot)?;
        if let Ok(old) = fs::metadata(file) {
            out.set_permissions(old.permissions()).with_context(cannot)?;
        }
        let made = make(&mut out)?;
        out.sync_all().and_then(|()| fs::rename(&part, file)).with_context(cannot)?;
        Ok(made)
    };
    write().inspect_err(|_| drop(fs::remove_file(&part)))
}

/// Opens an output that is written piece by piece and must not be there yet; a device or a pipe is opened as it is.
///
/// # Errors
/// [`io::ErrorKind::AlreadyExists`] for a file that is there; what the system says.
pub fn create_new(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    match Target::of(path)? {
        Target::Stdout => options.write(true).open("/dev/stdout"),
        Target::Stream => options.write(true).open(path),
        Target::File(file) => options.write(true).create_new(true).open(file),
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::{symlink, FileTypeExt, PermissionsExt};
    use std::process::Command;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("hrg-output-{}-{name}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).expect("a folder");
        folder
    }

    fn names(folder: &Path) -> Vec<String> {
        let all = fs::read_dir(folder).expect("readable");
        let mut names: Vec<String> = all.map(|e| e.expect("an entry").file_name().to_string_lossy().into()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_is_replaced_and_keeps_its_permissions() {
        let d = folder("file");
        let file = d.join("a");
        write_file(&file, b"one").expect("written");
        fs::set_permissions(&file, fs::Permissions::from_mode(0o640)).expect("set");
        write_file(&file, b"two").expect("written");
        assert_eq!(fs::read(&file).expect("there"), b"two");
        assert_eq!(fs::metadata(&file).expect("there").permissions().mode() & 0o777, 0o640);
        let e = write_file(&d.join("none/a"), b"three").expect_err("no folder");
        assert!(e.is::<BadInput>() && e.to_string().contains("there is no folder"), "{e}");
        assert!(write_file(&d, b"four").is_err(), "a folder is no file");
        assert_eq!(names(&d), ["a"], "nothing is left beside it");
    }

    #[test]
    fn a_link_stays_a_link() {
        let d = folder("link");
        fs::create_dir(d.join("b")).expect("a folder");
        fs::write(d.join("b/file"), "old").expect("written");
        symlink("b/file", d.join("link")).expect("linked");
        symlink("link", d.join("second")).expect("linked");
        symlink("b/new", d.join("dangling")).expect("linked");
        symlink("round", d.join("round")).expect("linked");
        write_file(&d.join("second"), b"through two").expect("written");
        write_file(&d.join("dangling"), b"made").expect("written");
        for link in ["link", "second", "dangling"] {
            assert!(fs::symlink_metadata(d.join(link)).expect("there").is_symlink(), "{link}");
        }
        assert_eq!(fs::read(d.join("b/file")).expect("there"), b"through two");
        assert_eq!(fs::read(d.join("b/new")).expect("there"), b"made");
        assert!(write_file(&d.join("round"), b"x").is_err());
        assert_eq!(names(&d.join("b")), ["file", "new"]);
    }

    #[test]
    fn a_pipe_and_a_device_are_written_into() {
        let d = folder("stream");
        let pipe = d.join("pipe");
        assert!(Command::new("mkfifo").arg(&pipe).status().expect("mkfifo runs").success());
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || fs::read(pipe).expect("readable")
        });
        write_file(&pipe, b"through").expect("written");
        assert_eq!(reader.join().expect("read"), b"through");
        assert!(fs::symlink_metadata(&pipe).expect("there").file_type().is_fifo());
        // A device of our own, where the system lets us make one.
        let device = d.join("null");
        if Command::new("mknod").arg(&device).args(["c", "1", "3"]).status().is_ok_and(|s| s.success()) {
            write_file(&device, b"away").expect("written");
            drop(create_new(&device).expect("opened"));
            assert!(fs::symlink_metadata(&device).expect("there").file_type().is_char_device());
        }
        assert!(names(&d).iter().all(|n| n == "pipe" || n == "null"), "{:?}", names(&d));
    }

    #[test]
    fn what_must_be_new_is_not_overwritten() {
        let d = folder("new");
        drop(create_new(&d.join("a")).expect("new"));
        assert_eq!(create_new(&d.join("a")).expect_err("there").kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(Target::of(Path::new("-")).expect("known"), Target::Stdout);
        assert_eq!(Target::of(Path::new("/dev/stdout")).expect("known"), Target::Stdout);
    }
}
