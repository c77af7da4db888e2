//! The catalogue F1 to F40 as cases that a replay can check, and what stands elsewhere or is missing.
//!
//! Times are those of `scenarios/faults.toml`: 40 to 245 s under water, satellites before and after.

use shared_types::Mode::{DeadReckoning, Degraded, Invalid};
use shared_types::RejectReason::{Duplicate, NotFinite, OutOfRange};
use shared_types::Sensor::{Dvl, Gnss, Imu, Lbl, Mcp, Ps};

use crate::faults::expect::Expect::{
    self, Accepted, Counted, Declared, Distance, Effect, Heading, Nees, Peak, Ratio, RatioAfter, Recovered, Refused,
    Resolved, Settled, Step, StepAfter, Vertical,
};
use crate::faults::run::{Setting, Start};

/// One class of the catalogue, injected in one way.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// Its number.
    pub number: u8,
    /// Of the mission.
    pub setting: Setting,
    /// Specs.
    pub faults: &'static [&'static str],
    /// Beyond the general rule: numbers finite, no panic, no error beyond five sigmas, 99.7 % within three.
    pub expect: &'static [Expect],
}

const fn case(number: u8, faults: &'static [&'static str], expect: &'static [Expect]) -> Case {
    Case { number, setting: Setting::AsItIs, faults, expect }
}

const fn set(number: u8, setting: Setting, faults: &'static [&'static str], expect: &'static [Expect]) -> Case {
    Case { number, setting, faults, expect }
}

/// Those that a replay can check.
pub const CASES: &[Case] = &[
    case(2, &["imu.gaps=0.05,20@100..200"], &[Step(1.0), Ratio(1.5), Recovered(30.0)]),
    case(2, &["imu.gaps=0.3,25@100..200"], &[Step(1.0), Ratio(1.5), Recovered(30.0)]),
    case(2, &["imu.gaps=1,40@100..200"], &[Step(1.0), Ratio(1.5), Recovered(30.0)]),
    case(2, &["imu.gaps=2,60@100..200"], &[Step(1.0), Recovered(30.0)]),
    // At the full scale that the configuration knows, and at one that it does not.
    case(3, &["imu.rail=35,157@150..151"], &[Heading(0.5), Recovered(30.0), Counted(Imu, OutOfRange)]),
    case(3, &["imu.rail=8.7,78@150..151"], &[Heading(0.5), Recovered(30.0)]),
    case(3, &["imu.saturate=0.04,9.85@90..110"], &[Heading(0.5), Recovered(30.0)]),
    case(3, &["imu.shock=0.05,30@130..135"], &[Heading(0.5), Recovered(30.0)]),
    case(4, &["imu.gyro_bias=1e-3,0,1e-3@100.."], &[RatioAfter(60.0, 1.25)]),
    case(4, &["imu.accel_bias=0.02,0.02,0.02@100.."], &[RatioAfter(60.0, 1.25)]),
    case(4, &["imu.gyro_ramp=1e-6@100.."], &[RatioAfter(60.0, 1.25)]),
    case(5, &["imu.axes@120..180"], &[Declared(Invalid, 2.0)]),
    case(5, &["imu.sign@120..180"], &[Declared(Invalid, 2.0)]),
    case(5, &["imu.stuck@120..180"], &[Declared(Invalid, 0.05)]),
    case(6, &["lbl.silent=1@100..200"], &[Peak, Recovered(30.0)]),
    case(6, &["lbl.blackout@120..180"], &[Declared(Degraded, 3.0), Accepted(Lbl, 5.0), Recovered(30.0)]),
    case(7, &["lbl.multipath=0.3@.."], &[Ratio(1.25), Peak, Refused(Lbl, 0.5)]),
    case(7, &["lbl.bursts=0.2,20@.."], &[Ratio(1.25), Peak]),
    case(7, &["lbl.clusters=0.2,20@.."], &[Ratio(1.25), Peak]),
    case(7, &["lbl.clusters=0.3,100@.."], &[Ratio(1.25), Peak]),
    case(8, &["lbl.identity=1,2,0.3@.."], &[Effect(1.0), Peak]),
    case(8, &["buoys.moved=10,90,2@.."], &[Effect(1.0), Peak]),
    case(8, &["buoys.moved=50,90,2@.."], &[Effect(1.0), Peak]),
    case(9, &["buoys.blackout@100..180"], &[Effect(1.0), Recovered(30.0)]),
    case(9, &["buoys.stuck@100..180"], &[Effect(1.0), Recovered(30.0)]),
    case(9, &["buoys.moved=30,90,4@100..180"], &[Effect(1.0), Peak, Recovered(30.0)]),
    case(10, &["lbl.bias=5,1@.."], &[Effect(1.0), Peak]),
    case(11, &["lbl.scale=1.01@.."], &[Ratio(1.2), Peak]),
    case(11, &["lbl.scale=1.01@150.."], &[Ratio(1.2), Peak]),
    case(12, &["lbl.delay=0.1@100..200"], &[Recovered(25.0)]),
    case(12, &["lbl.delay=5,2@100..200"], &[Recovered(25.0)]),
    case(12, &["lbl.delay=20@100..200"], &[Recovered(45.0)]),
    case(12, &["dvl.delay=5@100..200"], &[Recovered(25.0)]),
    case(12, &["mcp.delay=5@100..200", "ps.delay=5@100..200"], &[Recovered(25.0)]),
    case(12, &["lbl.out_of_order=0.2,1.5@100..200", "dvl.out_of_order=0.2,0.5@100..200"], &[Recovered(25.0)]),
    case(12, &["dvl.duplicate=0.5,0.1@.."], &[Effect(0.05), Counted(Dvl, Duplicate)]),
    case(12, &["lbl.duplicate=0.5,2@17..290"], &[Effect(0.05), Counted(Lbl, Duplicate)]),
    case(12, &["imu.duplicate=0.1@17.."], &[Effect(0.05), Counted(Imu, Duplicate)]),
    case(12, &["lbl.batch=10@100..200", "dvl.batch=5@100..200"], &[Recovered(25.0)]),
    case(13, &["dvl.blackout@110..170"], &[Step(1.0), Accepted(Dvl, 5.0), Recovered(30.0)]),
    case(15, &["dvl.spikes=0.03,1@.."], &[Ratio(1.25), Refused(Dvl, 0.9), Peak]),
    case(15, &["dvl.false_lock@110..170"], &[Refused(Dvl, 0.9), Peak, Accepted(Dvl, 5.0), Recovered(30.0)]),
    case(15, &["dvl.stuck@110..170"], &[Refused(Dvl, 0.5), Peak, Accepted(Dvl, 5.0), Recovered(30.0)]),
    case(15, &["dvl.scale=1.03@110..170"], &[Peak, Recovered(30.0)]),
    case(15, &["dvl.bias=0.1@110..170"], &[Peak, Recovered(30.0)]),
    case(15, &["dvl.mounting=180@110..170"], &[Refused(Dvl, 0.9), Peak, Recovered(30.0)]),
    case(16, &["ps.spikes=0.03,5@.."], &[Vertical(0.1)]),
    case(16, &["ps.bias=0.3@120.."], &[Vertical(0.1), Declared(Degraded, 5.0)]),
    case(16, &["ps.ramp=0.002@120.."], &[Vertical(0.1)]),
    case(16, &["ps.lag=10@200.."], &[Vertical(0.1), Declared(Degraded, 5.0)]),
    case(16, &["ps.swell=0.5,8@245.."], &[Vertical(0.1)]),
    case(16, &["ps.stuck@195..225"], &[Vertical(0.1), Declared(Degraded, 5.0)]),
    case(17, &["mcp.disturbance=20,60@120..180"], &[Heading(1.0), Recovered(30.0)]),
    case(17, &["mcp.bias=10@100.."], &[Heading(1.0), Ratio(1.25)]),
    case(17, &["mcp.spikes=0.03,30@.."], &[Heading(1.0), Ratio(1.25)]),
    case(18, &["gnss.jump=300@240..260"], &[Peak, Accepted(Gnss, 5.0), Recovered(5.0)]),
    case(18, &["gnss.poor=20,5@240.."], &[Peak]),
    case(18, &["gnss.spikes=0.1,50@.."], &[Peak, Ratio(1.25)]),
    case(19, &["gnss.jump=50@265.."], &[Peak, Refused(Gnss, 0.9)]),
    case(19, &["gnss.drag=5@260.."], &[Peak, Refused(Gnss, 0.9)]),
    case(19, &["gnss.drag=0.2@260.."], &[Peak]),
    case(20, &["imu.nan=0.01@17.."], &[Counted(Imu, NotFinite), Ratio(1.25)]),
    case(20, &["imu.huge=0.01@17.."], &[Counted(Imu, OutOfRange), Ratio(1.25)]),
    case(
        20,
        &["lbl.nan=0.1@17..", "dvl.inf=0.1@17.."],
        &[Counted(Lbl, NotFinite), Counted(Dvl, NotFinite), Ratio(1.25)],
    ),
    case(
        20,
        &["mcp.nan=0.1@17..", "ps.huge=0.1@17.."],
        &[Counted(Mcp, NotFinite), Counted(Ps, OutOfRange), Ratio(1.25)],
    ),
    case(20, &["gnss.sigma=0@.."], &[Ratio(1.25)]),
    case(20, &["gnss.sigma=-1@.."], &[Ratio(1.25)]),
    case(20, &["gnss.sigma=nan@.."], &[Ratio(1.25)]),
    case(20, &["gnss.sigma=1e12@17.."], &[Counted(Gnss, OutOfRange)]),
    case(21, &["dvl.stamp=31536000@120..150"], &[Recovered(30.0)]),
    case(21, &["dvl.stamp_wrap=100@.."], &[Peak]),
    case(21, &["imu.stamp=1@150..150.5"], &[Recovered(30.0)]),
    case(21, &["imu.stamp=-1@150..150.5"], &[Recovered(30.0)]),
    case(22, &["dvl.stamp=0.2@100.."], &[Ratio(1.25), Peak]),
    case(22, &["lbl.stamp=0.2@100.."], &[Ratio(1.25), Peak]),
    case(22, &["lbl.stamp_ramp=1e-4@.."], &[Ratio(1.25), Peak]),
    case(22, &["dvl.stamp_jitter=0.005@.."], &[Ratio(1.25), Peak]),
    case(22, &["dvl.stamp_reset@120..150"], &[Recovered(30.0)]),
    case(23, &["imu.stamp_jitter=1e-6@.."], &[Effect(0.05)]),
    // Begun so wrong that everything contradicts it.
    set(24, Setting::Position(1000.0), &[], &[Settled(60.0)]),
    // On a straight course nothing tells the place but one distance: in one run errors of a minute are one draw, and the mean of
    // two squares is above 5.9 in three of a thousand.
    set(25, Setting::OneBuoy(Start::Known), &[], &[Nees(5.9), Distance(2.0), Peak]),
    set(25, Setting::OneBuoy(Start::Within(100.0)), &[], &[Nees(5.9), Distance(2.0), Resolved(30.0)]),
    set(25, Setting::OneBuoy(Start::Mirrored(150.0)), &[], &[Nees(5.9), Distance(2.0), Resolved(30.0)]),
    // What was never there joins in mid-mission.
    case(35, &["dvl.blackout@..150"], &[Accepted(Dvl, 1.5), StepAfter(0.5), Recovered(30.0)]),
    case(35, &["lbl.silent=2@..150"], &[Accepted(Lbl, 1.5), StepAfter(0.5), Recovered(30.0)]),
    case(
        36,
        &["lbl.blackout@110..230", "dvl.blackout@110..230", "mcp.blackout@110..230", "ps.blackout@110..230"],
        &[Declared(DeadReckoning, 2.0), Accepted(Dvl, 5.0), Accepted(Lbl, 5.0), Recovered(30.0)],
    ),
    case(37, &["dvl.false_lock@110..170", "lbl.bias=50,1@110..170"], &[Peak, Recovered(30.0)]),
    // Started under way without a state: at the surface, and below it.
    case(38, &["imu.blackout@..30"], &[Recovered(180.0)]),
    case(38, &["imu.blackout@..100"], &[Recovered(180.0)]),
    set(38, Setting::Heading(180.0), &[], &[Settled(180.0)]),
    set(38, Setting::Heading(180.0), &["mcp.blackout@.."], &[Settled(180.0)]),
    set(40, Setting::At([0.0, 179.9999]), &[], &[Ratio(1.05)]),
    set(40, Setting::At([-45.0, 10.0]), &[], &[Ratio(1.05)]),
    set(40, Setting::At([89.9, -60.0]), &[], &[Ratio(1.05)]),
    set(40, Setting::Deeper(10_900.0), &[], &[Peak]),
];

/// Why a number has no case: what it needs.
pub fn elsewhere(number: u8) -> Option<&'static str> {
    match number {
        1 | 26..=34 => Some("over the bus: `ilns faults --live`"),
        14 => Some("missing: readings hold no single beams"),
        39 => Some("an endurance run: `experiments speed --hours 24`"),
        _ => None,
    }
}
