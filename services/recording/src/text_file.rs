//! A text file under construction: large writes, and a name that says when it is whole.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

use crate::error::LogError;

/// Bytes gathered before a write.
const CHUNK: usize = 256 * 1024;

/// A file that grows by lines. Its errors name it.
#[derive(Debug)]
pub(crate) struct TextFile {
    /// Where it is being written.
    path: PathBuf,
    /// Its name when whole; `None`: it bears it already.
    whole: Option<PathBuf>,
    file: File,
    text: Vec<u8>,
}

impl TextFile {
    /// Under its own name from the start: a recording that breaks off is still a recording.
    pub(crate) fn create(path: &Path) -> Result<TextFile, LogError> {
        let file = File::create(path).map_err(LogError::io(path, "create"))?;
        Ok(TextFile { path: path.to_owned(), whole: None, file, text: Vec::with_capacity(CHUNK + 4096) })
    }

    /// Under `path` with `.partial` behind it until [`TextFile::finish`]: a result that breaks off is none.
    pub(crate) fn create_partial(path: &Path) -> Result<TextFile, LogError> {
        let mut partial = path.as_os_str().to_owned();
        partial.push(".partial");
        let whole = Some(path.to_owned());
        Ok(TextFile { whole, ..TextFile::create(Path::new(&partial))? })
    }

    /// Where further text goes; call [`TextFile::row_done`] after each row.
    pub(crate) fn text(&mut self) -> &mut Vec<u8> {
        &mut self.text
    }

    /// Writes out when enough has gathered.
    pub(crate) fn row_done(&mut self) -> Result<(), LogError> {
        if self.text.len() >= CHUNK { self.flush() } else { Ok(()) }
    }

    /// Hands everything to the operating system.
    pub(crate) fn flush(&mut self) -> Result<(), LogError> {
        self.file.write_all(&self.text).map_err(LogError::io(&self.path, "write"))?;
        self.text.clear();
        Ok(())
    }

    /// Flushes and gives the file its name.
    pub(crate) fn finish(mut self) -> Result<(), LogError> {
        self.flush()?;
        match self.whole {
            None => Ok(()),
            Some(whole) => fs::rename(&self.path, &whole).map_err(LogError::io(&self.path, "rename")),
        }
    }
}
