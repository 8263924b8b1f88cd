//! Files that appear whole or not at all.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use crate::error::{Error, Result};

/// What a run left that did not come to its end is removed once nothing has changed in it for so long: another machine may be writing there.
const LEFT: Duration = Duration::from_secs(60);

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
    name.push(format!(".{}.tmp", std::process::id()));
    path.with_file_name(name)
}

/// Removes the temporary folders that runs left beside `path` which were killed.
fn remove_left(path: &Path) {
    let (Some(folder), Some(name)) = (path.parent(), path.file_name()) else { return };
    let start = format!(".{}.", name.to_string_lossy());
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let id = name.strip_prefix(&start).and_then(|rest| rest.strip_suffix(".tmp")).and_then(|id| id.parse().ok());
        let Some(id) = id else { continue };
        let changed = entry.metadata().and_then(|about| about.modified()).ok();
        let age = changed.and_then(|changed| SystemTime::now().duration_since(changed).ok());
        if !is_running(id) && age.is_some_and(|age| age > LEFT) {
            std::fs::remove_dir_all(entry.path()).unwrap_or_default();
        }
    }
}

/// Whether a process of this machine has the number; where that cannot be told, yes.
fn is_running(id: u32) -> bool {
    let processes = Path::new("/proc");
    !processes.join("self").exists() || processes.join(id.to_string()).exists()
}

/// A folder that is filled under a temporary name and appears when it is whole; dropped before, it is gone.
#[derive(Debug)]
pub struct NewFolder {
    goal: PathBuf,
    temporary: PathBuf,
}

impl NewFolder {
    /// A folder that will be at `path`, where there must be nothing yet (an empty folder will do).
    ///
    /// # Errors
    /// [`Error::Data`] where something is there already; [`Error::Io`].
    pub fn at(path: &Path) -> Result<Self> {
        if std::fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_some()) || path.is_file() {
            let reason = "is there already; choose another name or remove it".to_string();
            return Err(Error::Data { what: path.display().to_string(), reason });
        }
        let goal = std::path::absolute(path).map_err(Error::io(path))?;
        remove_left(&goal);
        let temporary = temporary_name(&goal);
        std::fs::create_dir_all(&temporary).map_err(Error::io(&temporary))?;
        Ok(Self { goal, temporary })
    }

    /// Where to put what belongs into it.
    pub fn path(&self) -> &Path {
        &self.temporary
    }

    /// Gives it its name.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn finish(self) -> Result<()> {
        // An empty folder in its place gives way.
        std::fs::remove_dir(&self.goal).unwrap_or_default();
        std::fs::rename(&self.temporary, &self.goal).map_err(Error::io(&self.goal))
    }
}

impl Drop for NewFolder {
    fn drop(&mut self) {
        std::fs::remove_dir_all(&self.temporary).unwrap_or_default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_os = "linux")]
    fn what_a_killed_run_left_goes_and_what_one_that_runs_writes_stays() {
        let folder = std::env::temp_dir().join(format!("gravisight-left-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let make = |id: u32, name: &str, age: u64| {
            let path = folder.join(format!(".{name}.{id}.tmp"));
            std::fs::create_dir(&path).unwrap();
            std::fs::write(path.join("part"), b"part").unwrap();
            let then = SystemTime::now() - Duration::from_secs(age);
            std::fs::File::open(&path).unwrap().set_modified(then).unwrap();
            path
        };
        // No process has so large a number.
        let killed = make(u32::MAX, "clips", 3600);
        let just_now = make(u32::MAX - 1, "clips", 1);
        let of_another = make(u32::MAX, "others", 3600);
        let running = make(std::process::id(), "other", 3600);
        let new = NewFolder::at(&folder.join("clips")).unwrap();
        assert!(!killed.exists() && just_now.exists() && of_another.exists() && running.exists());
        new.finish().unwrap();
        assert!(folder.join("clips").is_dir());
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
