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

    /// Hands everything to the operating system. What it refuses is kept, from the byte on at which it did: once it takes again, the
    /// file goes on without a break.
    pub(crate) fn flush(&mut self) -> Result<(), LogError> {
        let mut taken = 0;
        let result = loop {
            if taken == self.text.len() {
                break Ok(());
            }
            match self.file.write(&self.text[taken..]) {
                Ok(0) => break Err(std::io::ErrorKind::WriteZero.into()),
                Ok(bytes) => taken += bytes,
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                Err(error) => break Err(error),
            }
        };
        self.text.drain(..taken);
        result.map_err(LogError::io(&self.path, "write"))
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

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test may fail where it stands")]
    use super::*;

    #[test]
    fn what_a_full_disk_refuses_is_written_once_it_takes_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("imu.csv");
        let mut file = TextFile::create(&path).unwrap();
        file.text().extend_from_slice(b"first\n");
        file.flush().unwrap();
        // A device that has no room: every write to it is refused as on a full disk.
        let whole = std::mem::replace(&mut file.file, File::options().write(true).open("/dev/full").unwrap());
        file.text().extend_from_slice(b"second\n");
        let refused = file.flush().unwrap_err();
        assert!(refused.is_refusal() && refused.to_string().contains("imu.csv"), "{refused}");
        file.file = whole;
        file.flush().unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "first\nsecond\n");
    }
}
