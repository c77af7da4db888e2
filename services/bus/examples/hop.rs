//! One hop at the rate of an IMU: `cargo run --release -p ilns-bus --example hop [SECONDS]`.
//!
//! Two threads, each with a node of its own as two processes would have; one-way times from publication to receipt,
//! unfiltered.

use std::time::{Duration, Instant};

use ilns_bus::{Bus, Owner, Prefix, Reader};
use rustix::time::{ClockId, clock_gettime};
use shared_types::{Header, ImuSample, Process, channel};

const PERIOD: Duration = Duration::from_millis(5);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let seconds: u32 = std::env::args().nth(1).map_or(Ok(20), |text| text.parse())?;
    let samples = seconds * 200;
    let prefix = Prefix::new(&format!("hop-{}", std::process::id()))?;
    let owner = Owner::take(&prefix)?;
    let there = prefix.clone();
    let reader = std::thread::spawn(move || receive(&there, samples).map_err(|error| error.to_string()));
    let bus = Bus::join(&prefix, Process::EmulatorImu, 0)?;
    let mut publisher = bus.publisher(&channel::IMU)?;
    let mut published_in = Vec::new();
    let start = Instant::now() + Duration::from_millis(300);
    for index in 0..samples {
        std::thread::sleep((start + PERIOD * index).saturating_duration_since(Instant::now()));
        let begun = Instant::now();
        publisher.publish(ImuSample { header: Header::default(), gyro_body: [0.0; 3], accel_body: [0.0; 3] });
        published_in.push(begun.elapsed().as_nanos() as i64);
    }
    let hops = reader.join().map_err(|_| "the reader panicked")??;
    show("publish and ring", published_in);
    show("one hop", hops);
    drop((publisher, bus));
    owner.close();
    Ok(())
}

fn receive(prefix: &Prefix, samples: u32) -> Result<Vec<i64>, Box<dyn std::error::Error>> {
    let bus = Bus::join(prefix, Process::Propagator, 0)?;
    let mut subscriber = bus.subscriber(&channel::IMU)?;
    let waiter = bus.waiter(Reader::Propagator)?;
    let mut hops = Vec::new();
    let deadline = Instant::now() + PERIOD * samples + Duration::from_secs(2);
    while hops.len() < samples as usize && Instant::now() < deadline {
        waiter.wait();
        while let Some(sample) = subscriber.receive() {
            let now = clock_gettime(ClockId::Monotonic);
            hops.push(now.tv_sec * 1_000_000_000 + now.tv_nsec - sample.header.t_published);
        }
    }
    Ok(hops)
}

#[expect(clippy::print_stdout, reason = "its purpose")]
fn show(name: &str, mut times: Vec<i64>) {
    times.sort_unstable();
    let at = |share: f64| times.get((times.len() as f64 * share) as usize).map_or(0.0, |&ns| ns as f64 * 1e-3);
    let max = times.last().map_or(0.0, |&ns| ns as f64 * 1e-3);
    println!(
        "{name:>16}: {} samples, p50 {:.1} us, p99 {:.1} us, p99.9 {:.1} us, max {max:.1} us",
        times.len(),
        at(0.5),
        at(0.99),
        at(0.999)
    );
}
