//! The origin of the frame on disk, for as long as the run lasts: a restart of this process cannot move it, and neither can one of
//! the machine where solutions are kept for that: each of them names its frame.
//!
//! The bus cannot keep it: a channel's history dies with its sender. One line, `lat_deg lon_deg height t_ns`, in the
//! shortest form that gives the same bits back.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use ilns_recording::{CheckpointTerms, Kept, configuration_hash, kept_file};
use ilns_runtime::clocks_now;
use nav_preprocessing::Preprocessor;
use shared_types::{Config, FrameOrigin, Header, Time};
use tracing::{info, warn};

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

    /// A preprocessor with the origin that an earlier start of this run has kept. Where none has, and the machine was started anew since the
    /// solution of `set` in `folder` was kept, the run goes on: its beginning is past, and its frame is that solution's unless the
    /// configuration names one.
    pub(crate) fn begin(
        &self,
        mut config: Config,
        (folder, set): (Option<&Path>, &str),
    ) -> Result<Preprocessor, PreprocessorError> {
        let folder = if self.read()?.is_none() { folder } else { None };
        let Some((path, kept)) = folder.and_then(|folder| of_before(folder, set, &config)) else {
            return self.restore(Preprocessor::new(&config));
        };
        config.vehicle.initial.forget_state();
        config.vehicle.initial.t = None;
        let preprocessor = Preprocessor::new(&config);
        if preprocessor.origin().is_some() {
            return Ok(preprocessor);
        }
        info!("the machine was started anew: the frame stays where it was");
        let [lat_deg, lon_deg, height] = kept.solution.origin;
        // Of which time it is, the clock of the readings may not know any more.
        let origin = FrameOrigin { header: Header::default(), lat_deg, lon_deg, height };
        preprocessor.with_origin(origin).map_err(|source| PreprocessorError::OriginWrong { path, source })
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

/// The solution of `set` kept in `folder` before the machine was started anew, with its file, if it may be stood on.
fn of_before(folder: &Path, set: &str, config: &Config) -> Option<(PathBuf, Kept)> {
    let path = kept_file(folder, set);
    let terms = CheckpointTerms::after_a_restart(configuration_hash(&config.to_toml()), clocks_now());
    match terms.last_of_another_boot(&path) {
        Ok(kept) => kept.map(|kept| (path, kept)),
        Err(error) => {
            warn!(%error, "the frame kept for a restart of the machine cannot be taken up; it is fixed anew");
            None
        }
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
    fn after_a_restart_of_the_machine_the_frame_is_that_of_the_kept_solution_unless_the_configuration_names_one() {
        use ilns_recording::{Checkpoint, Durability, write_checkpoint};
        use shared_types::{Clocks, Solution};

        let folder = tempfile::tempdir().unwrap();
        let of_run = KeptOrigin::in_folder(&folder.path().join("run"));
        let config = Config::default();
        let solution = Solution { origin: [36.38, 127.36, 20.5], ..Solution::empty() };
        let now = clocks_now();
        let keep = |config: &Config, written: Clocks| {
            let checkpoint = Checkpoint { configuration: configuration_hash(&config.to_toml()), written, solution };
            write_checkpoint(&kept_file(folder.path(), "main"), &checkpoint, Durability::Power).unwrap();
        };
        let origin = |config: &Config| {
            let found = of_run.begin(config.clone(), (Some(folder.path()), "main")).unwrap();
            found.origin().map(|origin| [origin.lat_deg, origin.lon_deg, origin.height])
        };
        assert_eq!(origin(&config), None, "none was kept");
        keep(&config, now);
        assert_eq!(origin(&config), None, "of this start of the machine");
        keep(&config, Clocks { boot: now.boot ^ 1, ..now });
        assert_eq!(origin(&config), Some(solution.origin));
        keep(&config, Clocks { boot: now.boot ^ 1, wall: now.wall - 301_000_000_000, ..now });
        assert_eq!(origin(&config), None, "of another mission");
        let named = Config::load(&[], &["frame.origin=[10.0, 20.0, 0.0]".to_owned()]).unwrap();
        keep(&named, Clocks { boot: now.boot ^ 1, ..now });
        assert_eq!(origin(&named), Some([10.0, 20.0, 0.0]));
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
