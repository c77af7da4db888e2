//! The origin of the frame on disk, for as long as the run lasts: a restart of this process cannot move it.
//!
//! The bus cannot keep it: a channel's history dies with its sender. One line, `lat_deg lon_deg height t_ns`, in the
//! shortest form that gives the same bits back.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use nav_preprocessing::Preprocessor;
use shared_types::{FrameOrigin, Header, Time};

use crate::error::PreprocessorError;

const FILE: &str = "frame_origin";

/// The file.
#[derive(Debug)]
pub(crate) struct KeptOrigin {
    path: PathBuf,
}

impl KeptOrigin {
    /// In the folder of the run.
    pub(crate) fn in_folder(run_directory: &Path) -> KeptOrigin {
        KeptOrigin { path: run_directory.join(FILE) }
    }

    /// Gives a preprocessor the origin that an earlier start of this run has kept, if one has.
    pub(crate) fn restore(&self, preprocessor: Preprocessor) -> Result<Preprocessor, PreprocessorError> {
        let Some(origin) = self.read()? else { return Ok(preprocessor) };
        let wrong = |source| PreprocessorError::OriginWrong { path: self.path.clone(), source };
        preprocessor.with_origin(origin).map_err(wrong)
    }

    fn read(&self) -> Result<Option<FrameOrigin>, PreprocessorError> {
        let text = match fs::read_to_string(&self.path) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(self.io("read")(error)),
        };
        match parse(&text) {
            Some(origin) => Ok(Some(origin)),
            None => Err(PreprocessorError::OriginLost { path: self.path.clone() }),
        }
    }

    /// Keeps an origin, whole or not at all.
    pub(crate) fn write(&self, origin: &FrameOrigin) -> Result<(), PreprocessorError> {
        let FrameOrigin { header, lat_deg, lon_deg, height } = origin;
        if let Some(folder) = self.path.parent() {
            fs::create_dir_all(folder).map_err(self.io("make the folder of"))?;
        }
        let partial = self.path.with_extension("partial");
        fs::write(&partial, format!("{lat_deg} {lon_deg} {height} {}\n", header.t_valid)).map_err(self.io("write"))?;
        fs::rename(&partial, &self.path).map_err(self.io("write"))
    }

    fn io(&self, what: &'static str) -> impl FnOnce(std::io::Error) -> PreprocessorError {
        let path = self.path.clone();
        move |source| PreprocessorError::Io { what, path, source }
    }
}

fn parse(text: &str) -> Option<FrameOrigin> {
    let mut words = text.split_whitespace();
    let mut number = || words.next()?.parse().ok();
    let (lat_deg, lon_deg, height) = (number()?, number()?, number()?);
    let t = Time(words.next()?.parse().ok()?);
    words.next().is_none().then_some(FrameOrigin { header: Header::at(t), lat_deg, lon_deg, height })
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test may fail where it stands")]
    use super::*;

    #[test]
    fn an_origin_comes_back_to_the_bit() {
        let folder = tempfile::tempdir().unwrap();
        let kept = KeptOrigin::in_folder(&folder.path().join("run"));
        assert_eq!(kept.read().unwrap(), None);
        let origin = FrameOrigin {
            header: Header::at(Time(-5)),
            lat_deg: 63.1 / 3.0,
            lon_deg: -1e-17,
            height: f64::MIN_POSITIVE,
        };
        kept.write(&origin).unwrap();
        assert_eq!(kept.read().unwrap(), Some(origin));
    }

    #[test]
    fn a_file_that_holds_no_origin_is_an_error_and_not_a_new_frame() {
        let folder = tempfile::tempdir().unwrap();
        let kept = KeptOrigin::in_folder(folder.path());
        for text in ["", "36.0 127.0", "36.0 127.0 0.0 5 6", "a b c d"] {
            fs::write(folder.path().join(FILE), text).unwrap();
            assert!(matches!(kept.read(), Err(PreprocessorError::OriginLost { .. })), "{text:?}");
        }
        fs::write(folder.path().join(FILE), "NaN 0 0 0").unwrap();
        let restored = kept.restore(Preprocessor::new(&shared_types::Config::default()));
        assert!(matches!(restored, Err(PreprocessorError::OriginWrong { .. })));
    }
}
