//! The pose in one's own process: `cargo run --release --example consumer -- [PREFIX] [--raw]`.
//!
//! `--raw` writes the bytes of every estimate to standard output, as `deploy/include/ilns_estimate.h` lays them out, for a
//! consumer in another language: `consumer main --raw | ./consumer_in_c`.

use std::io::Write;

use ilns_bus::{Bus, Prefix, Reader};
use ilns_runtime::{DEFAULT_PREFIX, Shutdown};
use shared_types::{Mode, NavEstimate, Process, channel};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let raw = arguments.iter().any(|argument| argument == "--raw");
    let named = arguments.iter().find(|argument| !argument.starts_with("--"));
    let prefix = Prefix::new(named.map_or(DEFAULT_PREFIX, String::as_str))?;
    let shutdown = Shutdown::on_signals()?;
    let bus = Bus::join(&prefix, Process::Monitor, 0)?;
    let mut estimates = bus.subscriber(&channel::ESTIMATE)?;
    let waiter = bus.waiter(Reader::Vehicle)?;
    let mut out = std::io::stdout().lock();
    while !shutdown.requested() {
        waiter.wait();
        while let Some(estimate) = estimates.receive() {
            let [east, north, up] = estimate.position_enu;
            match estimate.mode() {
                _ if raw => out.write_all(bytes_of(&estimate))?,
                // Do not steer by these; the covariance says how good the others are.
                Mode::Initialising | Mode::Invalid => writeln!(out, "{}: no position", estimate.mode())?,
                mode => writeln!(out, "{mode}: east {east:.3} m, north {north:.3} m, up {up:.3} m")?,
            }
        }
        out.flush()?;
    }
    Ok(())
}

#[expect(
    unsafe_code,
    reason = "the message is repr(C), of plain numbers and without padding, which tests/c_layout.rs shows"
)]
fn bytes_of(estimate: &NavEstimate) -> &[u8] {
    unsafe { std::slice::from_raw_parts(std::ptr::from_ref(estimate).cast(), size_of::<NavEstimate>()) }
}
