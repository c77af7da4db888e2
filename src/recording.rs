//! `ilns recording`: what an MCAP holds, made whole, taken apart.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use ilns_recording::mcap::{Ending, Inspection, export, inspect, recover};
use ilns_runtime::answer;
use serde_json::json;

use crate::Outcome;

/// What to do with a recording.
#[derive(Args)]
pub(crate) struct RecordingArgs {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    /// Show channels, counts, times, gaps and losses of an MCAP, and whether it is whole.
    Info {
        /// The MCAP.
        file: PathBuf,
        /// As one JSON object.
        #[arg(long)]
        json: bool,
    },
    /// Write what can be read of a torn or damaged MCAP into another, with summary and indexes.
    Recover {
        /// The MCAP that was torn.
        file: PathBuf,
        /// The MCAP to write; it must not exist.
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
    },
    /// Write the log directory of a recording, as the recorder wrote it.
    Export {
        /// The MCAPs of one recording, in their order.
        #[arg(required = true)]
        files: Vec<PathBuf>,
        /// The folder to write; it must not hold a log.
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
}

pub(crate) fn run(args: &RecordingArgs) -> Outcome {
    match &args.action {
        Action::Info { file, json } => {
            let found = inspect(file)?;
            let text = if *json { format!("{:#}", as_json(&found)) } else { as_text(&found) };
            answer(&text)?;
        }
        Action::Recover { file, out } => {
            let recovered = recover(file, out)?;
            answer(&format!("{}: {} messages; {}", out.display(), recovered.messages, condition(&recovered.ending)))?;
        }
        Action::Export { files, out } => {
            let exported = export(files, out)?;
            let rows: Vec<String> = exported.rows.iter().map(|(name, rows)| format!("{name} {rows}")).collect();
            answer(&format!("{}: rows: {}", out.display(), rows.join(", ")))?;
            for (file, ending) in files.iter().zip(&exported.endings).filter(|(_, ending)| !ending.is_whole()) {
                eprintln!("{}: {}", file.display(), condition(ending));
            }
        }
    }
    Ok(())
}

/// How whole an MCAP is, in words.
pub(crate) fn condition(ending: &Ending) -> String {
    if ending.is_whole() {
        return "whole".to_owned();
    }
    let mut parts = Vec::new();
    if let Some((offset, why)) = ending.broken {
        let behind = ending.bytes.saturating_sub(offset);
        parts.push(format!("read up to byte {offset} ({why}; {behind} bytes behind it are lost)"));
    }
    if ending.damaged_chunks + ending.damaged_records > 0 {
        let (chunks, records) = (ending.damaged_chunks, ending.damaged_records);
        parts.push(format!("{chunks} damaged chunks and {records} damaged records were left out"));
    }
    parts.join("; ")
}

fn as_text(found: &Inspection) -> String {
    let mut lines = vec![format!("written by   {}", found.library)];
    if let Some((first, last)) = found.span() {
        lines.push(format!("data time    {first} s to {last} s ({:.1} s)", (last - first).as_seconds()));
    }
    lines.push(format!("size         {} bytes, {} messages", found.ending.bytes, found.messages()));
    lines.push(format!("attachments  {}", found.attachments.join(", ")));
    lines.push(format!("dropped      {} before the file, {} before the recorder", found.dropped, found.lost));
    lines.push(format!("condition    {}", condition(&found.ending)));
    lines.push(format!(
        "{:<20} {:<26} {:>9} {:>9} {:>12} {:>8}",
        "channel", "schema", "messages", "rate Hz", "longest gap", "missing"
    ));
    for channel in &found.channels {
        let span = channel.span.map_or(0.0, |(first, last)| (last - first).as_seconds());
        let rate = if span > 0.0 { format!("{:.1}", (channel.messages - 1) as f64 / span) } else { "-".to_owned() };
        let gap = channel.longest_gap.map_or("-".to_owned(), |(gap, _)| format!("{:.3} s", gap.as_seconds()));
        lines.push(format!(
            "{:<20} {:<26} {:>9} {:>9} {:>12} {:>8}",
            channel.topic, channel.schema, channel.messages, rate, gap, channel.missing
        ));
    }
    lines.join("\n")
}

fn as_json(found: &Inspection) -> serde_json::Value {
    let channels: Vec<_> = found
        .channels
        .iter()
        .map(|channel| {
            let [first, last] = [0, 1].map(|end| channel.span.map(|span| if end == 0 { span.0 } else { span.1 }.0));
            json!({
                "topic": channel.topic, "schema": channel.schema, "messages": channel.messages,
                "first_ns": first, "last_ns": last, "missing": channel.missing,
                "longest_gap_ns": channel.longest_gap.map(|(gap, _)| gap.0),
                "longest_gap_at_ns": channel.longest_gap.map(|(_, at)| at.0),
            })
        })
        .collect();
    json!({
        "library": found.library, "bytes": found.ending.bytes, "messages": found.messages(),
        "attachments": found.attachments, "dropped": found.dropped, "lost": found.lost,
        "whole": found.ending.is_whole(), "finished": found.ending.is_finished,
        "broken_at": found.ending.broken.map(|(offset, _)| offset),
        "damaged_chunks": found.ending.damaged_chunks, "damaged_records": found.ending.damaged_records,
        "channels": channels,
    })
}
