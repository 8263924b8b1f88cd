//! Files that appear whole or not at all.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

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

/// A folder that is filled under a temporary name and appears when it is whole; dropped before, it is gone.
#[derive(Debug)]
pub struct NewFolder {
    path: PathBuf,
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
        let path = std::path::absolute(path).map_err(Error::io(path))?;
        let temporary = temporary_name(&path);
        std::fs::create_dir_all(&temporary).map_err(Error::io(&temporary))?;
        Ok(Self { path, temporary })
    }

    /// Where to put what belongs into it.
    #[allow(clippy::misnamed_getters)] // its name is not its own until it is whole
    pub fn path(&self) -> &Path {
        &self.temporary
    }

    /// Gives it its name.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn finish(self) -> Result<()> {
        // An empty folder in its place gives way.
        std::fs::remove_dir(&self.path).unwrap_or_default();
        std::fs::rename(&self.temporary, &self.path).map_err(Error::io(&self.path))
    }
}

impl Drop for NewFolder {
    fn drop(&mut self) {
        std::fs::remove_dir_all(&self.temporary).unwrap_or_default();
    }
}
