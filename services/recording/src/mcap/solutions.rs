//! When each solution reached the published estimates of a recording.

use std::path::Path;

use shared_types::Time;

use super::json::number_of;
use super::reader::{Item, McapFault, read};
use super::topics::Topic;
use crate::error::LogError;

/// Data time of the first estimate that stands on each solution, and the number of the solution, from `files`: one
/// recording, in the order of its files.
///
/// # Errors
/// A file is no MCAP of today, or an estimate in it is not as this program writes it.
pub fn solutions(files: &[impl AsRef<Path>]) -> Result<Vec<(Time, u64)>, LogError> {
    let mut reached: Vec<(Time, u64)> = Vec::new();
    for file in files {
        let (file, mut channel, mut number) = (file.as_ref(), None, 0);
        read(file, &mut |item| {
            match item {
                Item::Channel(found) if Topic::of(&found) == Some(Topic::Estimate) => channel = Some(found.id),
                Item::Message(header, message) if Some(header.channel_id) == channel => {
                    number += 1;
                    let t = number_of(message, "t").and_then(|text| Time::parse(text).ok());
                    let solution = number_of(message, "solution")
                        .and_then(|digits| std::str::from_utf8(digits).ok()?.parse().ok());
                    let Some((t, solution)) = t.zip(solution) else {
                        let fault = McapFault::message(Topic::Estimate.name(), number, message);
                        return Err(LogError::Mcap { file: file.to_owned(), fault });
                    };
                    if reached.last().is_none_or(|&(_, last)| last != solution) {
                        reached.push((t, solution));
                    }
                }
                _ => {}
            }
            Ok(())
        })?;
    }
    Ok(reached)
}
