//! What stands in an MCAP: channels, counts, times, gaps, losses, and whether it is whole.

use std::collections::BTreeMap;
use std::path::Path;

use shared_types::{Duration, Time};

use super::json::flat_cells;
use super::reader::{Ending, Item, read};
use super::topics::Topic;
use crate::error::LogError;

/// A file, looked through.
#[derive(Clone, Debug, PartialEq)]
pub struct Inspection {
    /// Who wrote it.
    pub library: String,
    /// Channels by their name.
    pub channels: Vec<ChannelReport>,
    /// Names of attachments.
    pub attachments: Vec<String>,
    /// Messages that the recorder had no room for, as far as it could still say.
    pub dropped: u64,
    /// Messages that did not reach the recorder.
    pub lost: u64,
    /// How it ends.
    pub ending: Ending,
}

impl Inspection {
    /// First and last data time of all channels.
    pub fn span(&self) -> Option<(Time, Time)> {
        self.channels.iter().filter_map(|channel| channel.span).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    }

    /// All messages.
    pub fn messages(&self) -> u64 {
        self.channels.iter().map(|channel| channel.messages).sum()
    }
}

/// One channel.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelReport {
    /// Its name.
    pub topic: String,
    /// Name of its schema.
    pub schema: String,
    /// Messages.
    pub messages: u64,
    /// First and last `log_time`.
    pub span: Option<(Time, Time)>,
    /// Longest time between two messages, and where it begins.
    pub longest_gap: Option<(Duration, Time)>,
    /// Readings that the sender counted and the file does not have; none where messages are not counted by their sender.
    pub missing: u64,
    last_sequence: Option<u64>,
    is_counted: bool,
}

impl ChannelReport {
    fn message(&mut self, log_time: u64, data: &[u8]) {
        let t = Time(i64::try_from(log_time).unwrap_or(i64::MAX));
        self.messages += 1;
        let (first, last) = self.span.unwrap_or((t, t));
        let gap = Duration(t.0.saturating_sub(last.0));
        if self.messages > 1 && self.longest_gap.is_none_or(|(longest, _)| gap > longest) {
            self.longest_gap = Some((gap, last));
        }
        self.span = Some((first.min(t), last.max(t)));
        if self.is_counted {
            self.count(data);
        }
    }

    fn count(&mut self, data: &[u8]) {
        let sequence = number(data, "sequence");
        if let (Some(before), Some(now)) = (self.last_sequence, sequence) {
            // A sender that was restarted counts from 0 again.
            self.missing += now.saturating_sub(before).saturating_sub(1);
        }
        self.last_sequence = sequence;
    }
}

fn number(message: &[u8], key: &str) -> Option<u64> {
    flat_cells(message)?.into_iter().find(|(name, _)| *name == key)?.1.parse().ok()
}

/// Looks `file` through. Any uncompressed MCAP will do.
///
/// # Errors
/// It is no MCAP, or cannot be read.
pub fn inspect(file: impl AsRef<Path>) -> Result<Inspection, LogError> {
    let mut schemas = BTreeMap::<u16, String>::new();
    let mut channels = BTreeMap::<u16, ChannelReport>::new();
    let (mut library, mut attachments) = (String::new(), Vec::new());
    let (mut dropped, mut lost, mut without_channel) = (0, 0, 0);
    let mut ending = read(file.as_ref(), &mut |item| {
        match item {
            Item::Library(found) => library = found,
            Item::Schema(header, _) => drop(schemas.insert(header.id, header.name)),
            Item::Channel(channel) => {
                let is_sensor = |topic: &Topic| matches!(topic, Topic::Sensor(_)) && topic.name() == channel.topic;
                let is_counted = Topic::ALL.iter().any(is_sensor);
                channels.entry(channel.id).or_insert_with(|| ChannelReport {
                    schema: schemas.get(&channel.schema_id).cloned().unwrap_or_default(),
                    topic: channel.topic,
                    messages: 0,
                    span: None,
                    longest_gap: None,
                    missing: 0,
                    last_sequence: None,
                    is_counted,
                });
            }
            Item::Message(header, data) => match channels.get_mut(&header.channel_id) {
                Some(channel) => {
                    channel.message(header.log_time, data);
                    if channel.topic == Topic::Recorder.name() {
                        dropped = number(data, "dropped").unwrap_or(dropped);
                        lost = number(data, "lost").unwrap_or(lost);
                    }
                }
                None => without_channel += 1,
            },
            Item::Attachment(header, _) => attachments.push(header.name),
            Item::Metadata(_) => {}
        }
        Ok(())
    })?;
    ending.damaged_records += without_channel;
    let mut channels: Vec<ChannelReport> = channels.into_values().collect();
    channels.sort_by(|a, b| a.topic.cmp(&b.topic));
    Ok(Inspection { library, channels, attachments, dropped, lost, ending })
}
