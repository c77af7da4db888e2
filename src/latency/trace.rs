//! A trace for Perfetto and chrome://tracing: every sample on its way, every solve, on one time axis.
//!
//! Trace Event Format, complete events (`ph: X`), times in µs since the first sample. Driver, propagator and consumer are
//! one track each; a span ends when the next process has the datum.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use serde_json::{Value, json};

use super::consumer::{Consumed, Row};

const TRACKS: [(u32, &str); 4] = [(1, "driver"), (2, "propagator"), (3, "consumer"), (4, "solver (CPU time)")];

/// Creates the file.
pub(super) fn create(file: &Path) -> std::io::Result<File> {
    File::create(file)
}

/// Writes the trace.
pub(super) fn write(file: File, consumed: &Consumed) -> std::io::Result<()> {
    let mut out = BufWriter::new(file);
    out.write_all(b"{\"displayTimeUnit\":\"ns\",\"traceEvents\":[")?;
    let mut first = true;
    for event in events(consumed) {
        out.write_all(if first { b"\n" } else { b",\n" })?;
        first = false;
        serde_json::to_writer(&mut out, &event)?;
    }
    out.write_all(b"\n]}\n")?;
    out.flush()
}

fn events(consumed: &Consumed) -> impl Iterator<Item = Value> {
    let zero = consumed.rows.first().map_or(0, |row| row.t_arrival);
    let names = TRACKS
        .into_iter()
        .map(|(tid, name)| json!({ "ph": "M", "name": "thread_name", "pid": 1, "tid": tid, "args": { "name": name } }));
    let samples = consumed.rows.iter().flat_map(move |row| spans(row, zero));
    let solves = consumed.solves.iter().map(move |solve| {
        let begun = solve.published - solve.solve_ns as i64;
        span("solve", 4, begun - zero, solve.published - zero, solve.id)
    });
    names.chain(samples).chain(solves)
}

fn spans(row: &Row, zero: i64) -> [Value; 3] {
    [
        span("read", 1, row.t_arrival - zero, row.published - zero, row.sequence),
        span("imu to estimate", 2, row.published - zero, row.estimated - zero, row.sequence),
        span("estimate to consumer", 3, row.estimated - zero, row.received - zero, row.sequence),
    ]
}

fn span(name: &str, tid: u32, from: i64, until: i64, sequence: u64) -> Value {
    let us = |ns: i64| ns as f64 * 1e-3;
    json!({
        "ph": "X", "name": name, "pid": 1, "tid": tid, "ts": us(from), "dur": us(until - from),
        "args": { "sequence": sequence },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_is_three_spans_that_follow_one_another() {
        let row = Row { sequence: 7, t_arrival: 1_000, published: 2_000, estimated: 22_000, received: 45_000 };
        let [read, hop, consumed] = spans(&row, 1_000);
        assert_eq!((read["ts"].as_f64(), read["dur"].as_f64()), (Some(0.0), Some(1.0)));
        assert_eq!((hop["ts"].as_f64(), hop["dur"].as_f64()), (Some(1.0), Some(20.0)));
        assert_eq!((consumed["ts"].as_f64(), consumed["dur"].as_f64()), (Some(21.0), Some(23.0)));
        assert_eq!(consumed["args"]["sequence"], 7);
    }
}
