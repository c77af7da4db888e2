//! What the sensors say without errors, against what the truth's own numbers give by another way.

use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector3};
use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{Duration, RawReading, Sensor, Time, Truth};
use sim_world::{Preset, Scenario, World};

fn exact(name: &str) -> (Scenario, World) {
    let scenario = Scenario::builtin(name).expect("it is built in");
    let world = World::new(&scenario, Preset::None, 1).expect("it is valid");
    (scenario, world)
}

fn frame(scenario: &Scenario) -> LocalFrame {
    let [lat_deg, lon_deg, height] = scenario.origin_deg;
    LocalFrame::new(Geodetic::from_degrees(lat_deg, lon_deg, height))
}

/// ENU position of a body point, from the truth as it is written.
fn point(frame: &LocalFrame, truth: &Truth, lever_arm_body: [f64; 3]) -> Vector3<f64> {
    let imu_enu = frame.to_enu(&Geodetic::from_degrees(truth.lat_deg, truth.lon_deg, truth.height));
    imu_enu + attitude(truth) * Vector3::from(lever_arm_body)
}

fn attitude(truth: &Truth) -> UnitQuaternion<f64> {
    let [w, x, y, z] = truth.q_enu_body;
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
}

#[test]
fn a_doppler_velocity_is_the_change_of_the_transducer_s_position() {
    let (scenario, world) = exact("mission");
    let setup = scenario.dvl.clone().expect("it is fitted");
    let frame = frame(&scenario);
    let [roll, pitch, yaw] = setup.mounting_rpy_deg.map(f64::to_radians);
    let r_body_dvl = Rotation3::from_euler_angles(roll, pitch, yaw);
    let step = Duration(2_000_000);
    for reading in world.dvl().skip(100).step_by(37) {
        let t = Time(reading.header.t_valid);
        let [before, here, after] = [t - step, t, t + step].map(|t| world.truth(t));
        let moved = point(&frame, &after, setup.lever_arm_body) - point(&frame, &before, setup.lever_arm_body);
        let velocity_enu = moved / (2.0 * step.as_seconds());
        let velocity_dvl = r_body_dvl.inverse() * (attitude(&here).inverse() * velocity_enu);
        let error = (velocity_dvl - Vector3::from(reading.velocity_dvl)).norm();
        // Rounding of a position through degrees over 4 ms, and the third derivative.
        assert!(error < 3e-6, "{t}: {error}");
    }
}

#[test]
fn a_range_is_the_distance_of_two_points_given_in_degrees() {
    let (scenario, world) = exact("outage");
    let lever_arm = scenario.lbl.clone().expect("it is fitted").lever_arm_body;
    let buoys: Vec<_> = world.buoys().collect();
    assert!(buoys.iter().all(|buoy| buoy.moored == 1 && buoy.header.t_valid == 0), "{buoys:?}");
    let frame = frame(&scenario);
    for range in world.lbl().step_by(13) {
        let buoy = buoys.iter().find(|buoy| buoy.buoy == range.buoy).expect("it reported");
        let buoy_enu = frame.to_enu(&Geodetic::from_degrees(buoy.lat_deg, buoy.lon_deg, buoy.height));
        let transducer_enu = point(&frame, &world.truth(Time(range.header.t_valid)), lever_arm);
        assert!(((transducer_enu - buoy_enu).norm() - range.range).abs() < 1e-7);
        assert_eq!(range.in_epoch, 4);
    }
}

#[test]
fn a_heading_is_the_yaw_angle_turned_by_declination_and_meridian_convergence() {
    let (scenario, world) = exact("mission");
    for reading in world.mcp().step_by(91) {
        let t = Time(reading.header.t_valid);
        let ahead_enu = attitude(&world.truth(t)) * Vector3::x();
        let grid_deg = ahead_enu.x.atan2(ahead_enu.y).to_degrees();
        // East of the origin true north lies to the left of the n-axis: convergence E tan φ / N.
        let east = world.motion(t).position_enu.x;
        let convergence_deg = (east * 36.38_f64.to_radians().tan() / 6_385_700.0).to_degrees();
        let expected = grid_deg + convergence_deg + 8.6;
        let error = (reading.heading_deg - expected + 180.0).rem_euclid(360.0) - 180.0;
        // The tilt of the local plane times the pitch of up to 0.4 rad.
        assert!(error.abs() < 2e-3, "{t}: {error}");
        assert!((0.0..360.0).contains(&reading.heading_deg));
    }
    assert_eq!(scenario.mcp.expect("it is fitted").declination_deg, -8.6);
}

#[test]
fn depth_is_the_height_of_the_port_below_the_surface() {
    let (scenario, world) = exact("mission");
    let lever_arm = scenario.ps.clone().expect("it is fitted").lever_arm_body;
    let frame = frame(&scenario);
    for reading in world.ps().step_by(97) {
        let port_enu = point(&frame, &world.truth(Time(reading.header.t_valid)), lever_arm);
        assert!((reading.depth + frame.height_at(&port_enu)).abs() < 1e-7);
    }
}

#[test]
fn the_mission_dives_to_fifty_metres_and_sees_satellites_before_the_dive_only() {
    let (_, world) = exact("mission");
    let depth = |t: f64| -world.truth(Time::from_seconds(t)).height;
    assert!(depth(399.0).abs() < 1e-3 && (depth(501.0) - 50.0).abs() < 0.01, "{} {}", depth(399.0), depth(501.0));
    let fixes: Vec<f64> = world.gnss().map(|fix| Time(fix.header.t_valid).as_seconds()).collect();
    assert!(fixes.len() > 390 && fixes.iter().all(|t| *t < 415.0), "{} fixes, last {:?}", fixes.len(), fixes.last());
    assert_eq!(world.duration(), Duration::from_seconds(2217.0));
    for t in [0.0, 8.5, 17.0] {
        let motion = world.motion(Time::from_seconds(t));
        assert_eq!((motion.position_enu.norm(), motion.velocity_enu.norm()), (0.0, 0.0), "still at {t} s");
    }
}

#[test]
fn the_outage_silences_ranges_velocities_and_headings_and_ends_with_satellites() {
    let (_, world) = exact("outage");
    let gap = |t: i64| (1_683_000_000_000..=1_783_000_000_000).contains(&t);
    let silent = [Sensor::Lbl, Sensor::Dvl, Sensor::Mcp, Sensor::Gnss];
    let mut seen = [0_u32; 7];
    for reading in world.readings().skip_while(|reading| reading.t_valid().0 < 1_600_000_000_000) {
        assert!(!(gap(reading.t_valid().0) && silent.contains(&reading.sensor())), "{reading:?}");
        seen[reading.sensor().index()] += 1;
    }
    assert_eq!(seen[Sensor::Imu.index()], 617 * 200 + 1);
    assert_eq!(seen[Sensor::Ps.index()], 6170);
    assert_eq!(seen[Sensor::Gnss.index()], 2217 - 1783, "{seen:?}");
    assert!(world.truth(Time::from_seconds(1783.0)).height.abs() < 1e-3);
}

#[test]
fn the_stable_run_is_straight_at_six_tenths_of_a_metre_per_second() {
    let (_, world) = exact("stable");
    for t in [40.0, 300.0, 617.0] {
        let motion = world.motion(Time::from_seconds(t));
        let bearing_deg = motion.velocity_enu.x.atan2(motion.velocity_enu.y).to_degrees();
        assert!((motion.velocity_enu.norm() - 0.6).abs() < 1e-6 && (bearing_deg - 10.0).abs() < 1e-6, "{motion:?}");
    }
    assert_eq!(world.gnss().count(), 0);
}

#[test]
fn readings_are_merged_by_time_and_equal_times_in_the_order_of_the_format() {
    let text = sim_world::BUILTIN_SCENARIOS[0].1;
    // All phases zero: every second all sensors read at once.
    let text: String = text.lines().filter(|line| !line.starts_with("phase")).map(|line| format!("{line}\n")).collect();
    let scenario = Scenario::parse(&text, std::path::Path::new("zero.toml")).expect("it is valid");
    let world = World::new(&scenario, Preset::Realistic, 1).expect("it is valid");
    let place = |reading: &RawReading| match reading.sensor() {
        Sensor::Imu => 0,
        Sensor::Buoys => 1,
        Sensor::Gnss => 2,
        Sensor::Dvl => 3,
        Sensor::Mcp => 4,
        Sensor::Ps => 5,
        Sensor::Lbl => 6,
    };
    let readings: Vec<RawReading> = world.readings().take(50_000).collect();
    for pair in readings.windows(2) {
        let (a, b) = (&pair[0], &pair[1]);
        assert!((a.t_valid(), place(a)) <= (b.t_valid(), place(b)), "{a:?} before {b:?}");
    }
    let first: Vec<Sensor> = readings.iter().take_while(|r| r.t_valid() == Time(0)).map(RawReading::sensor).collect();
    assert_eq!(first.len(), 1 + 4 + 1 + 1 + 1 + 1 + 4, "{first:?}");
}

#[test]
fn a_drifting_buoy_is_where_its_reports_say_between_two_of_them() {
    let text = sim_world::BUILTIN_SCENARIOS[1].1.replacen(
        "position = [0.0, -500.0, 0.0]",
        "velocity = [0.2, -0.1, 0.0]\nwander = { amplitude = 2.0, period = 300.0 }\nfix_every = 1.0\nposition = [0.0, -500.0, 0.0]",
        1,
    );
    let scenario = Scenario::parse(&text, std::path::Path::new("drift.toml")).expect("it is valid");
    let world = World::new(&scenario, Preset::None, 7).expect("it is valid");
    let frame = frame(&scenario);
    let track: Vec<_> = world.buoys().filter(|fix| fix.buoy == 1).collect();
    assert_eq!(track.len(), 618);
    assert!(track.iter().all(|fix| fix.moored == 0));
    let at = |index: usize| {
        frame.to_enu(&Geodetic::from_degrees(track[index].lat_deg, track[index].lon_deg, track[index].height))
    };
    assert!((at(617) - at(0) - Vector3::new(0.2, -0.1, 0.0) * 617.0).norm() < 4.0 * 2.0_f64.sqrt());
    let lever_arm = scenario.lbl.clone().expect("it is fitted").lever_arm_body;
    for range in world.lbl().filter(|range| range.buoy == 1).take(600) {
        let t = range.header.t_valid;
        let index = (t / 1_000_000_000) as usize;
        let buoy_enu = at(index).lerp(&at(index + 1), (t % 1_000_000_000) as f64 * 1e-9);
        let distance = (point(&frame, &world.truth(Time(t)), lever_arm) - buoy_enu).norm();
        // A straight line between two reports leaves a(1 s)²/8.
        assert!((distance - range.range).abs() < 2e-4, "{t}: {distance} {}", range.range);
    }
}
