//! Files that appear whole or not at all.

use std::fs::TryLockError;
use std::hash::{BuildHasher as _, RandomState};
use std::io::{Read as _, Seek as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::time::{Duration, SystemTime};

use crate::error::{Error, Result};

/// What a run left that did not come to its end is removed once nothing has changed in it for so long: another machine may be
/// writing there, whose lock this one does not see.
const LEFT: Duration = Duration::from_secs(60);
/// The file in a folder that the run which writes there holds locked.
const LOCK: &str = ".lock";
/// What tells this process from all others that write to the same disk: a number that another machine or container may have
/// given a process of its own is not enough.
static PROCESS: LazyLock<String> =
    LazyLock::new(|| format!("{}-{:08x}", std::process::id(), RandomState::new().hash_one(0) as u32));

/// Largest file that is read into memory, bytes: labels of a million frames have less. Videos are not read so.
const LARGEST: u64 = 512 << 20;

/// What is in the file at `path`, where that is at most 512 MB.
///
/// # Errors
/// [`Error::Io`]; [`Error::Data`] for a larger file, or one without end, of which no more is read.
pub fn read(path: &Path) -> Result<Vec<u8>> {
    let mut file = std::fs::File::open(path).map_err(Error::io(path))?;
    let says = file.metadata().map_err(Error::io(path))?.len();
    let mut bytes = Vec::new();
    if says <= LARGEST {
        (&mut file).take(LARGEST + 1).read_to_end(&mut bytes).map_err(Error::io(path))?;
    }
    if says.max(bytes.len() as u64) > LARGEST {
        let reason = format!("is larger than {} MB, the most that can be read; split it", LARGEST >> 20);
        return Err(Error::Data { what: path.display().to_string(), reason });
    }
    Ok(bytes)
}

/// The text in the file at `path`.
///
/// # Errors
/// As [`read`]; [`Error::Format`] for what is no UTF-8.
pub fn read_text(path: &Path) -> Result<String> {
    let refuse = Error::format(path.display().to_string());
    String::from_utf8(read(path)?).map_err(|error| refuse(format!("is not a text file ({})", error.utf8_error())))
}

/// A folder that one run writes into, and no other while it runs: a lock on a file in it that names the process. The system
/// takes it back when the process ends, however that comes.
#[derive(Debug)]
pub struct Claim {
    _file: std::fs::File,
}

impl Claim {
    /// Of `folder`, which is there. Where the file system knows no locks, all runs have it.
    ///
    /// # Errors
    /// [`Error::Data`] with the other's number where another run has it; [`Error::Io`].
    pub fn of(folder: &Path) -> Result<Self> {
        let path = folder.join(LOCK);
        let mut options = std::fs::OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false);
        let mut file = options.open(&path).map_err(Error::io(&path))?;
        if let Err(TryLockError::WouldBlock) = file.try_lock() {
            let mut other = String::new();
            // On some systems a locked file cannot be read.
            file.take(20).read_to_string(&mut other).unwrap_or_default();
            let reason = format!("process {} is writing there; wait for it, or choose another folder", other.trim());
            return Err(Error::Data { what: folder.display().to_string(), reason });
        }
        let named = file.set_len(0).and_then(|()| file.rewind()).and_then(|()| write!(file, "{}", std::process::id()));
        named.map_err(Error::io(&path))?;
        Ok(Self { _file: file })
    }
}

/// Writes `bytes` under a temporary name beside `path`, syncs, then renames.
///
/// # Errors
/// [`Error::Io`] with the path.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let temporary = temporary_name(path);
    let written = std::fs::File::create(&temporary)
        .and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()))
        .and_then(|()| std::fs::rename(&temporary, path));
    written.inspect_err(|_| std::fs::remove_file(&temporary).unwrap_or_default()).map_err(Error::io(path))
}

/// Name beside `path` for what is not whole yet.
pub(crate) fn temporary_name(path: &Path) -> PathBuf {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{}.tmp", *PROCESS));
    path.with_file_name(name)
}

/// Removes the temporary folders that runs left beside `path` which were killed.
fn remove_left(path: &Path) {
    let (Some(folder), Some(name)) = (path.parent(), path.file_name()) else { return };
    let start = format!(".{}.", name.to_string_lossy());
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        // A longer name may begin as this one does.
        let process = name.strip_prefix(&start).and_then(|rest| rest.strip_suffix(".tmp"));
        if process.is_none_or(|process| process.contains('.')) {
            continue;
        }
        let age = last_change(&entry.path()).and_then(|changed| SystemTime::now().duration_since(changed).ok());
        if is_abandoned(&entry.path()) && age.is_some_and(|age| age > LEFT) {
            std::fs::remove_dir_all(entry.path()).unwrap_or_default();
        }
    }
}

/// Whether a run has begun to fill the folder and does no longer, on whatever machine: nobody holds its lock. Where there is
/// none, or the file system knows no locks, no.
fn is_abandoned(folder: &Path) -> bool {
    std::fs::OpenOptions::new().read(true).write(true).open(folder.join(LOCK)).is_ok_and(|lock| lock.try_lock().is_ok())
}

/// When something in a folder, or the folder itself, was changed last.
fn last_change(path: &Path) -> Option<SystemTime> {
    let about = std::fs::symlink_metadata(path).ok()?;
    let inside = about.is_dir().then(|| std::fs::read_dir(path)).into_iter().flatten().flatten().flatten();
    inside.filter_map(|entry| last_change(&entry.path())).chain(about.modified().ok()).max()
}

/// A folder that is filled under a temporary name and appears when it is whole; dropped before, it is gone.
#[derive(Debug)]
pub struct NewFolder {
    goal: PathBuf,
    temporary: PathBuf,
    /// By which other runs know that this one lives.
    claim: Option<Claim>,
}

impl NewFolder {
    /// A folder that will be at `path`, where there must be nothing yet (an empty folder will do).
    ///
    /// # Errors
    /// [`Error::Data`] where something is there already; [`Error::Io`].
    pub fn at(path: &Path) -> Result<Self> {
        if std::fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_some()) || path.is_file() {
            let reason = "already exists; choose another name or remove it".to_string();
            return Err(Error::Data { what: path.display().to_string(), reason });
        }
        let goal = std::path::absolute(path).map_err(Error::io(path))?;
        remove_left(&goal);
        let temporary = temporary_name(&goal);
        std::fs::create_dir_all(&temporary).map_err(Error::io(&temporary))?;
        let mut new = Self { goal, temporary, claim: None };
        // Where that fails, `new` removes what it made.
        new.claim = Some(Claim::of(&new.temporary)?);
        Ok(new)
    }

    /// Where to put what belongs into it.
    pub fn path(&self) -> &Path {
        &self.temporary
    }

    /// Gives it its name.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn finish(mut self) -> Result<()> {
        // Some systems move and remove no file that is open.
        self.claim = None;
        let lock = self.temporary.join(LOCK);
        std::fs::remove_file(&lock).map_err(Error::io(&lock))?;
        // An empty folder in its place gives way.
        std::fs::remove_dir(&self.goal).unwrap_or_default();
        std::fs::rename(&self.temporary, &self.goal).map_err(Error::io(&self.goal))
    }
}

impl Drop for NewFolder {
    fn drop(&mut self) {
        self.claim = None;
        std::fs::remove_dir_all(&self.temporary).unwrap_or_default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_too_large_and_without_end_are_refused_and_text_is_utf8() {
        let path = std::env::temp_dir().join(format!("gravisight-large-{}", std::process::id()));
        // It takes no room.
        std::fs::File::create(&path).unwrap().set_len(6 << 30).unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("512 MB"));
        std::fs::write(&path, b"\xff\xfe").unwrap();
        assert!(matches!(read_text(&path), Err(Error::Format { .. })));
        std::fs::remove_file(&path).unwrap();
        assert!(matches!(read(&path), Err(Error::Io { .. })));
        #[cfg(target_os = "linux")]
        assert!(read(Path::new("/dev/zero")).unwrap_err().to_string().contains("512 MB"));
    }

    #[test]
    #[cfg(unix)]
    fn a_link_is_replaced_and_what_it_points_to_stays() {
        let folder = std::env::temp_dir().join(format!("gravisight-link-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let [elsewhere, link] = ["elsewhere", "link"].map(|name| folder.join(name));
        std::fs::write(&elsewhere, b"theirs").unwrap();
        std::os::unix::fs::symlink(&elsewhere, &link).unwrap();
        write_whole(&link, b"ours").unwrap();
        assert_eq!(std::fs::read(&elsewhere).unwrap(), b"theirs");
        assert_eq!(std::fs::read(&link).unwrap(), b"ours");
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    #[cfg(unix)]
    fn what_a_killed_run_left_goes_and_what_one_that_runs_anywhere_writes_stays() {
        let folder = std::env::temp_dir().join(format!("gravisight-left-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let make = |name: &str, age: u64| {
            let path = folder.join(format!(".{name}.tmp"));
            std::fs::create_dir(&path).unwrap();
            let then = SystemTime::now() - Duration::from_secs(age);
            for file in ["part", LOCK] {
                let file = std::fs::File::create(path.join(file)).unwrap();
                file.set_modified(then).unwrap();
            }
            std::fs::File::open(&path).unwrap().set_modified(then).unwrap();
            path
        };
        // As a run in another container would name it: no process here has the number, and its lock is all that is known.
        let elsewhere = make("clips.4294967295-0", 3600);
        let lock = std::fs::File::open(elsewhere.join(LOCK)).unwrap();
        lock.lock().unwrap();
        let killed = make("clips.4294967294-0", 3600);
        let just_now = make("clips.4294967293-0", 1);
        let busy = make("clips.4294967292-0", 3600);
        std::fs::File::open(busy.join("part")).unwrap().set_modified(SystemTime::now()).unwrap();
        let of_another = make("others.4294967295-0", 3600);
        let longer_name = make("clips.b.4294967295-0", 3600);
        let new = NewFolder::at(&folder.join("clips")).unwrap();
        assert!(elsewhere.exists(), "another machine's run was taken for dead");
        assert!(!killed.exists() && just_now.exists() && busy.exists() && of_another.exists() && longer_name.exists());
        assert!(new.path().join(LOCK).exists());
        new.finish().unwrap();
        assert!(
            std::fs::read_dir(folder.join("clips")).unwrap().next().is_none(),
            "the lock is no part of what was made"
        );
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
