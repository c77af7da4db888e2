//! A depth sensor of one's own on `sensor/ps`: `cargo run --release --example driver -- [PREFIX] [DEPTH]`.
//!
//! Beside a set that runs with `[emulator-ps] external = true` in its process file (`deploy/hardware_in_the_loop.md`), or
//! under systemd as `ilns-driver@ps`.

use ilns_bus::{Bus, Prefix};
use ilns_runtime::{DEFAULT_PREFIX, HeartbeatBuilder, Shutdown, StartClock, monotonic_now};
use shared_types::{Header, Process, ProcessState, PsDepth, Sensor, Time, channel};

/// Between two readings, ns.
const PERIOD: i64 = 100_000_000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let prefix = Prefix::new(&arguments.next().unwrap_or_else(|| DEFAULT_PREFIX.to_owned()))?;
    let depth: f64 = arguments.next().map_or(Ok(50.0), |text| text.parse())?;
    let shutdown = Shutdown::on_signals()?;
    let bus = Bus::join(&prefix, Process::EmulatorPs, 0)?;
    let mut readings = bus.publisher(&channel::PS)?;
    let mut health = bus.publisher(&channel::HEALTH)?;
    let mut heartbeat = HeartbeatBuilder::new(Process::EmulatorPs, 0);
    heartbeat.state = ProcessState::Running;
    // Data time is that of the run; where nobody has set one, every driver takes the monotonic clock.
    let start = std::fs::read_to_string(prefix.run_directory().join("start")).unwrap_or_default();
    let clock = start.parse().unwrap_or(StartClock { data: Time(0), mono: 0, rate: 1.0 });
    let mut due = monotonic_now();
    while shutdown.sleep_until(due) {
        due += PERIOD;
        // Here the instrument would be read. `t_valid`: when its content held; `t_arrival`: when it reached us.
        let t_arrival = monotonic_now();
        let t_valid = clock.data_at(t_arrival);
        readings.publish(PsDepth { header: Header { t_arrival, ..Header::at(t_valid) }, depth });
        heartbeat.reading(Sensor::Ps, t_valid);
        if let Some(beat) = heartbeat.beat(t_arrival) {
            bus.check_owner()?;
            health.publish(beat);
        }
    }
    Ok(())
}
