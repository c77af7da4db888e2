//! The log directory of a recording, from its MCAP.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use super::json::flat_cells;
use super::reader::{Ending, Item, McapFault, read};
use super::topics::{LogFile, Topic};
use super::writer::{CONFIG, FORMAT, FORMAT_RECORD};
use crate::error::LogError;
use crate::log_writer::refuse_existing_log;
use crate::text_file::TextFile;

/// What was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exported {
    /// Rows per file of the log directory.
    pub rows: BTreeMap<&'static str, u64>,
    /// How each MCAP ends, in their order.
    pub endings: Vec<Ending>,
}

/// Writes the readings of `files` (one recording, in the order of its files) into the log directory `out`, as the recorder
/// wrote them: the same bytes. Made where there is none. The configuration is that of the first file.
///
/// # Errors
/// A file is no MCAP of this program, `out` holds a log, the operating system refused.
pub fn export(files: &[impl AsRef<Path>], out: impl AsRef<Path>) -> Result<Exported, LogError> {
    let out = out.as_ref();
    for file in files {
        check(file.as_ref())?;
    }
    fs::create_dir_all(out).map_err(LogError::io(out, "create the directory"))?;
    refuse_existing_log(out)?;
    let mut log = Log { files: Default::default(), rows: [0; Topic::ALL.len()], out, has_config: false };
    let mut endings = Vec::new();
    for file in files {
        endings.push(log.take(file.as_ref())?);
    }
    let mut rows = BTreeMap::new();
    for (topic, count) in Topic::ALL.into_iter().zip(log.rows) {
        if let Some(file) = topic.log_file().filter(|_| count > 0) {
            rows.insert(file.name, count);
        }
    }
    log.files.iter_mut().flatten().try_for_each(TextFile::flush)?;
    Ok(Exported { rows, endings })
}

/// Refuses what would leave half a log behind.
fn check(file: &Path) -> Result<(), LogError> {
    let mut has_imu = false;
    read(file, &mut |item| {
        match item {
            Item::Channel(channel) => has_imu |= Topic::of(&channel).is_some_and(|topic| topic == Topic::ALL[0]),
            Item::Metadata(metadata) if metadata.name == FORMAT_RECORD => {
                let found = metadata.metadata.get("format").cloned().unwrap_or_default();
                if found.parse().is_ok_and(|format: u32| format > FORMAT) {
                    let fault = McapFault::FutureFormat { found, known: FORMAT };
                    return Err(LogError::Mcap { file: file.to_owned(), fault });
                }
            }
            _ => {}
        }
        Ok(())
    })?;
    if !has_imu {
        return Err(LogError::Mcap { file: file.to_owned(), fault: McapFault::NoReadings });
    }
    Ok(())
}

struct Log<'a> {
    files: [Option<TextFile>; Topic::ALL.len()],
    rows: [u64; Topic::ALL.len()],
    out: &'a Path,
    has_config: bool,
}

impl Log<'_> {
    fn take(&mut self, file: &Path) -> Result<Ending, LogError> {
        let mut channels = BTreeMap::<u16, (Topic, LogFile)>::new();
        read(file, &mut |item| match item {
            Item::Channel(channel) => {
                if let Some((topic, log_file)) = Topic::of(&channel).and_then(|topic| Some((topic, topic.log_file()?)))
                {
                    channels.insert(channel.id, (topic, log_file));
                }
                Ok(())
            }
            Item::Message(header, data) => match channels.get(&header.channel_id) {
                Some(&(topic, log_file)) => self.row(file, topic, &log_file, data),
                None => Ok(()),
            },
            Item::Attachment(header, data) if header.name == CONFIG && !self.has_config => {
                self.has_config = true;
                let config = self.out.join(CONFIG);
                fs::write(&config, data).map_err(LogError::io(&config, "write"))
            }
            _ => Ok(()),
        })
    }

    fn row(&mut self, mcap: &Path, topic: Topic, log_file: &LogFile, message: &[u8]) -> Result<(), LogError> {
        let index = topic.index();
        self.rows[index] += 1;
        let fault = || {
            let fault = McapFault::message(topic.name(), self.rows[index], message);
            LogError::Mcap { file: mcap.to_owned(), fault }
        };
        let cells = flat_cells(message).ok_or_else(fault)?;
        let file = match &mut self.files[index] {
            Some(file) => file,
            empty => {
                let mut file = TextFile::create(&self.out.join(log_file.name))?;
                let header: Vec<&str> = log_file.columns().collect();
                file.text().extend_from_slice(header.join(",").as_bytes());
                file.text().push(b'\n');
                empty.insert(file)
            }
        };
        let text = file.text();
        for (place, column) in log_file.columns().enumerate() {
            if place > 0 {
                text.push(b',');
            }
            let cell = cells.iter().find(|(key, _)| *key == column).map_or("nan", |(_, cell)| cell);
            text.extend_from_slice(cell.as_bytes());
        }
        text.push(b'\n');
        file.row_done()
    }
}
