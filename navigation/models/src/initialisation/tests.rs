//! Still and moving starts, each part of the first state from its sensor.

use approx::assert_relative_eq;
use shared_types::KeyframeCause;

use super::*;
use crate::preintegration::Preintegration;
use crate::testing::{random, world};
use crate::transport::transport as carry;
use rand_distr::{Distribution, Normal};

const PERIOD: i64 = 5_000_000;

fn config() -> Config {
    let mut config = Config::default();
    config.vehicle.gnss.lever_arm_body = [0.4, -0.15, 0.25];
    config
}

/// Roll, pitch, yaw of the vehicle under test.
fn r_enu_body() -> Matrix3<f64> {
    nalgebra::Rotation3::from_euler_angles(0.1, -0.2, 0.7).into_inner()
}

const HEADING: f64 = core::f64::consts::FRAC_PI_2 - 0.7;
const GYRO_BIAS_TRUE: Vector3<f64> = Vector3::new(1e-4, -8e-5, 5e-5);

fn at_rest() -> ImuPoint {
    let world = world();
    ImuPoint {
        gyro_body: r_enu_body().tr_mul(&world.earth_rate_enu) + GYRO_BIAS_TRUE,
        accel_body: -(r_enu_body().tr_mul(&world.gravity.at(&Vector3::zeros()))),
    }
}

fn push_imu(initialiser: &mut Initialiser, seconds: f64, sample_at: impl Fn(f64) -> ImuPoint) {
    for index in 0..=(seconds * 200.0) as i64 {
        let t = Time(index * PERIOD);
        let point = sample_at(t.as_seconds());
        let reading = Reading::Imu { gyro_body: point.gyro_body.into(), accel_body: point.accel_body.into() };
        initialiser.push(&Measurement::new(t, t, &reading));
    }
}

fn push(initialiser: &mut Initialiser, t: f64, reading: &Reading) {
    initialiser.push(&Measurement::new(Time::from_seconds(t), Time::from_seconds(t), reading));
}

fn fix_at(position: Vector3<f64>) -> Reading {
    let antenna = position + r_enu_body() * Vector3::new(0.4, -0.15, 0.25);
    Reading::Gnss { antenna_enu: antenna.into(), sigma_enu: [0.5, 0.5, 1.0] }
}

#[test]
fn a_still_vehicle_is_levelled_turned_to_its_compass_and_put_at_its_fix() {
    let mut initialiser = Initialiser::new(&config());
    push_imu(&mut initialiser, 5.0, |_| at_rest());
    push(&mut initialiser, 4.9, &Reading::Mcp { heading: HEADING });
    push(&mut initialiser, 4.9, &Reading::Dvl { velocity_dvl: [0.0; 3] });
    let position = Vector3::new(12.0, -7.0, 0.3);
    push(&mut initialiser, 4.8, &fix_at(position));
    push(&mut initialiser, 5.0, &Reading::Keyframe { cause: KeyframeCause::Start });
    let (state, covariance) = initialiser.first_state(Time::from_seconds(5.0), &world()).expect("all is there");
    assert_relative_eq!(state.r_enu_body(), r_enu_body(), epsilon = 1e-5);
    assert_relative_eq!(state.position_enu, position, epsilon = 1e-5);
    assert_relative_eq!(state.velocity_enu, Vector3::zeros(), epsilon = 1e-5);
    assert_relative_eq!(state.gyro_bias, GYRO_BIAS_TRUE, epsilon = 1e-8);
    assert!(covariance.cholesky().is_some(), "{covariance}");
    // The heading (2°) moves the lever arm (0.4 m) by 1.5 cm.
    assert_relative_eq!(covariance[(0, 0)].sqrt(), 0.5, max_relative = 1e-3);
    assert!(covariance[(3, 3)].sqrt() < 0.02, "{} m/s", covariance[(3, 3)].sqrt());
}

#[test]
fn levelling_correlates_tilt_with_the_accelerometer_bias_as_many_levellings_do() {
    let config = config();
    let bias_sigma = config.vehicle.imu.accel_bias_sigma;
    let mut rng = random(41);
    let draw = Normal::new(0.0, bias_sigma).expect("a sigma");
    let mut sampled = Matrix3::<f64>::zeros();
    let mut claimed = Matrix3::<f64>::zeros();
    const RUNS: usize = 400;
    for _ in 0..RUNS {
        let bias = Vector3::from_fn(|_, _| draw.sample(&mut rng));
        let mut initialiser = Initialiser::new(&config);
        push_imu(&mut initialiser, 2.0, |_| ImuPoint { accel_body: at_rest().accel_body + bias, ..at_rest() });
        push(&mut initialiser, 2.0, &Reading::Mcp { heading: HEADING });
        push(&mut initialiser, 2.0, &fix_at(Vector3::zeros()));
        let (state, covariance) = initialiser.first_state(Time::from_seconds(2.0), &world()).expect("all is there");
        let truth = state.r_enu_body().transpose() * r_enu_body();
        // Heading is given: the part about the up axis is none of levelling's.
        let up = r_enu_body().row(2).transpose();
        let tilt = so3::log(&truth);
        let tilt = tilt - up * up.dot(&tilt);
        sampled += tilt * bias.transpose() / RUNS as f64;
        claimed = covariance.fixed_view::<3, 3>(ATTITUDE, ACCEL_BIAS).into_owned();
    }
    // Four sigmas of a product of two, each known to 1/√n.
    let tolerance = 4.0 * bias_sigma * bias_sigma / 9.8 / (RUNS as f64).sqrt();
    assert_relative_eq!(sampled, claimed, epsilon = tolerance);
    assert!(claimed.amax() > 3.0 * tolerance);
}

#[test]
fn nothing_is_told_before_two_seconds_of_samples_a_heading_and_a_position() {
    let t = Time::from_seconds(3.0);
    let tell = |seconds: f64, heading: bool, fix: bool| {
        let mut initialiser = Initialiser::new(&config());
        push_imu(&mut initialiser, seconds, |_| at_rest());
        if heading {
            push(&mut initialiser, seconds, &Reading::Mcp { heading: HEADING });
        }
        if fix {
            push(&mut initialiser, seconds, &fix_at(Vector3::zeros()));
        }
        initialiser.first_state(Time::from_seconds(seconds), &world()).is_some()
    };
    assert!(tell(3.0, true, true));
    assert!(!tell(1.5, true, true));
    assert!(!tell(3.0, false, true));
    assert!(!tell(3.0, true, false));
    assert!(Initialiser::new(&config()).first_state(t, &world()).is_none());
}

#[test]
fn a_given_state_is_carried_to_the_keyframe() {
    let mut config = config();
    config.vehicle.initial.t = Some(Time::from_seconds(1.0));
    config.vehicle.initial.position_enu = Some([10.0, 20.0, -5.0]);
    config.vehicle.initial.velocity_enu = Some([1.0, 0.5, 0.0]);
    let q = nalgebra::UnitQuaternion::from_matrix(&r_enu_body());
    config.vehicle.initial.q_enu_body = Some([q.w, q.i, q.j, q.k]);
    let mut initialiser = Initialiser::new(&config);
    push_imu(&mut initialiser, 3.0, |_| at_rest());
    assert!(initialiser.first_state(Time::from_seconds(0.9), &world()).is_none());
    let (given, prior) = initialiser.first_state(Time::from_seconds(1.0), &world()).expect("given");
    assert_eq!(given.position_enu, Vector3::new(10.0, 20.0, -5.0));
    assert_eq!((given.gyro_bias, given.accel_bias), (Vector3::zeros(), Vector3::zeros()));
    // Half a sample beyond a sample.
    let (later, covariance) = initialiser.first_state(Time(2_002_500_000), &world()).expect("carried");
    let mut increment = Preintegration::new(Vector3::zeros(), Vector3::zeros());
    for _ in 0..401 {
        increment.step_mean(0.0025, &at_rest(), &at_rest());
    }
    let expected = carry(&given, &increment, &world());
    assert_relative_eq!(later.position_enu, expected.position_enu, epsilon = 1e-6);
    assert!(covariance[(0, 0)] > prior[(0, 0)] + 0.009, "{} from {}", covariance[(0, 0)], prior[(0, 0)]);
    // Not beyond the samples.
    assert!(initialiser.first_state(Time::from_seconds(9.0), &world()).is_none());
}

#[test]
fn ranges_and_depth_tell_the_position_and_the_mirror_does_not_win() {
    let truth = Vector3::new(80.0, -60.0, -40.0);
    let buoys = [[0.0, -500.0, 0.0], [-400.0, 0.0, 0.0], [-200.0, 1000.0, 0.0], [200.0, 500.0, 0.0]].map(Vector3::from);
    let tell = |offset_sigma: f64, offset: f64, with_depth: bool, count: usize| {
        let mut config = config();
        config.navigator.lbl_common_offset_sigma = offset_sigma;
        let mut initialiser = Initialiser::new(&config);
        push_imu(&mut initialiser, 3.0, |_| at_rest());
        push(&mut initialiser, 3.0, &Reading::Mcp { heading: HEADING });
        if with_depth {
            push(&mut initialiser, 3.0, &Reading::Ps { depth: -world().frame.height_at(&truth) });
        }
        for (number, buoy) in buoys.iter().enumerate().take(count) {
            let range = (truth - buoy).norm() - offset;
            let reading = Reading::Lbl {
                buoy: number as u32,
                epoch: 4,
                range,
                buoy_enu: (*buoy).into(),
                buoy_sigma: 0.0,
                is_moored: true,
            };
            push(&mut initialiser, 3.0, &reading);
        }
        initialiser.first_state(Time::from_seconds(3.0), &world())
    };
    let (state, covariance) = tell(0.0, 0.0, true, 4).expect("four ranges and a depth");
    assert_relative_eq!(state.position_enu, truth, epsilon = 1e-4);
    assert!(covariance[(0, 0)].sqrt() < 1.0 && covariance[(2, 2)].sqrt() < 0.02);
    // Without depth both sides fit; the one in the water is taken.
    let (state, _) = tell(0.0, 0.0, false, 3).expect("three ranges");
    assert_relative_eq!(state.position_enu, truth, epsilon = 1e-2);
    // Differences see no common offset; raw ranges that share one do not meet.
    let (state, _) = tell(f64::INFINITY, 25.0, true, 4).expect("three differences and a depth");
    assert_relative_eq!(state.position_enu, truth, epsilon = 1e-3);
    assert!(tell(0.0, 25.0, true, 4).is_none());
    assert!(tell(f64::INFINITY, 0.0, true, 3).is_none());
    assert!(tell(0.0, 0.0, true, 2).is_none());
}

#[test]
fn ranges_of_buoys_asked_in_turn_tell_the_position_of_a_vehicle_under_way() {
    let buoys = [[0.0, -500.0, 0.0], [-400.0, 0.0, 0.0], [-200.0, 1000.0, 0.0]].map(Vector3::from);
    let way = |t: f64| Vector3::new(40.0 + 2.0 * t, -60.0, -30.0);
    let tell = |offset_sigma: f64, apart: f64| {
        let mut config = config();
        config.navigator.lbl_common_offset_sigma = offset_sigma;
        config.vehicle.lbl.lever_arm_body = [0.0; 3];
        config.vehicle.ps.lever_arm_body = [0.0; 3];
        let mut initialiser = Initialiser::new(&config);
        let t_end = 8.0;
        riding(&mut initialiser, t_end, Some(2.0));
        push(&mut initialiser, t_end, &Reading::Ps { depth: -world().frame.height_at(&way(t_end)) });
        // An older range of a buoy that has answered again says nothing any more.
        for (turn, number) in [1, 0, 1, 2].into_iter().enumerate() {
            let t = t_end - 0.3 - apart * (3 - turn) as f64;
            let range = if turn == 0 { 9.0 } else { (way(t) - buoys[number]).norm() };
            let buoy_enu = buoys[number].into();
            let (buoy, epoch) = (number as u32, turn as u32);
            push(&mut initialiser, t, &Reading::Lbl { buoy, epoch, range, buoy_enu, buoy_sigma: 0.0, is_moored: true });
        }
        initialiser.first_state(Time::from_seconds(t_end), &world())
    };
    let (state, covariance) = tell(0.0, 2.0).expect("three ranges within ten seconds");
    assert_relative_eq!(state.position_enu, way(8.0), epsilon = 0.05);
    assert!((0.05..1.5).contains(&covariance[(0, 0)].sqrt()), "{} m", covariance[(0, 0)].sqrt());
    // Each has an offset of its own; and after so long the vehicle is somewhere else.
    assert!(tell(0.5, 2.0).is_none());
    assert!(tell(0.0, 6.0).is_none());
}

#[test]
fn a_run_does_not_begin_at_a_wild_fix() {
    let start = |fixes: &[(f64, [f64; 3])], depth: Option<f64>| {
        let mut initialiser = Initialiser::new(&config());
        push_imu(&mut initialiser, 4.0, |_| at_rest());
        push(&mut initialiser, 4.0, &Reading::Mcp { heading: HEADING });
        for &(t, antenna_enu) in fixes {
            push(&mut initialiser, t, &Reading::Gnss { antenna_enu, sigma_enu: [0.5, 0.5, 1.0] });
        }
        if let Some(depth) = depth {
            fixes.iter().for_each(|&(t, _)| push(&mut initialiser, t, &Reading::Ps { depth }));
        }
        initialiser.first_state(Time::from_seconds(4.0), &world()).is_some()
    };
    let (right, wild) = ([1.0, 2.0, 0.3], [1.0, -34.0, 12.4]);
    assert!(start(&[(4.0, right)], None) && start(&[(4.0, right)], Some(0.2)));
    // Nothing speaks against it but a depth, or another fix.
    assert!(start(&[(4.0, wild)], None) && !start(&[(4.0, wild)], Some(0.2)));
    assert!(!start(&[(3.0, right), (4.0, wild)], None) && !start(&[(3.0, wild), (4.0, right)], None));
    assert!(start(&[(3.0, wild), (4.0, right)], Some(0.2)));
    // Heights above another surface than ours disagree with every depth: two that agree are not wild.
    assert!(start(&[(3.0, [1.0, 2.0, 40.3]), (4.0, [1.2, 2.0, 39.8])], Some(0.2)));
}

#[test]
fn an_accelerating_vehicle_is_levelled_by_what_the_dvl_saw() {
    // Straight ahead in the body with 0.3 m/s², tilted as ever.
    let acceleration = Vector3::new(0.3, 0.0, 0.0);
    let mut initialiser = Initialiser::new(&config());
    push_imu(&mut initialiser, 4.0, |_| ImuPoint { accel_body: at_rest().accel_body + acceleration, ..at_rest() });
    for tenth in 0..=40 {
        let t = f64::from(tenth) * 0.1;
        let velocity_dvl = (Vector3::x() * 0.5 + acceleration * t).into();
        push(&mut initialiser, t, &Reading::Dvl { velocity_dvl });
    }
    push(&mut initialiser, 4.0, &Reading::Mcp { heading: HEADING });
    push(&mut initialiser, 4.0, &fix_at(Vector3::zeros()));
    let (state, covariance) = initialiser.first_state(Time::from_seconds(4.0), &world()).expect("all is there");
    // Coriolis and the Earth's rate are below; without the DVL tilt would be off by 0.03 rad.
    assert_relative_eq!(state.r_enu_body(), r_enu_body(), epsilon = 1e-3);
    assert_relative_eq!(state.velocity_enu, r_enu_body() * Vector3::new(1.7, 0.0, 0.0), epsilon = 2e-3);
    // 3° before the velocities are seen; what is left is the heading's 2° about an axis that is 0.2 rad off body z.
    assert!((3e-4..1e-2).contains(&covariance[(6, 6)].sqrt()), "tilt to {} rad", covariance[(6, 6)].sqrt());
    let least = config().vehicle.imu.gyro_bias_sigma;
    assert!(state.gyro_bias.amax() < least, "no bias is taken from a stretch under way: {}", state.gyro_bias);
}

#[test]
fn without_a_compass_a_track_gives_the_heading() {
    let mut initialiser = Initialiser::new(&config());
    let level = ImuPoint { gyro_body: Vector3::zeros(), accel_body: Vector3::new(0.0, 0.0, 9.8) };
    push_imu(&mut initialiser, 5.0, |_| level);
    // Five metres per second to the north-west.
    for second in 0..=5 {
        let way = 5.0 * f64::from(second) / 2.0_f64.sqrt();
        let antenna_enu = [-way, way, 0.0];
        push(&mut initialiser, f64::from(second), &Reading::Gnss { antenna_enu, sigma_enu: [0.5, 0.5, f64::INFINITY] });
    }
    let (state, covariance) = initialiser.first_state(Time::from_seconds(5.0), &world()).expect("a track");
    let heading = crate::sensors::McpModel::predicted_heading(&state, &world());
    assert_relative_eq!(heading, -core::f64::consts::FRAC_PI_4, epsilon = 1e-5);
    assert_relative_eq!(covariance[(8, 8)].sqrt(), 0.175, epsilon = 0.01);
    assert_relative_eq!(state.velocity_enu.xy().norm(), 5.0, epsilon = 1e-9);
}

#[test]
fn a_vehicle_that_is_set_sideways_does_not_head_along_its_track() {
    // Half as fast to the left as ahead, 1.5 m/s to the north-west over ground; or a track that the DVL did not see.
    for expected in [Some(0.5_f64.atan()), None] {
        let mut initialiser = Initialiser::new(&config());
        push_imu(&mut initialiser, 5.0, |_| ImuPoint { gyro_body: Vector3::zeros(), accel_body: Vector3::z() * 9.8 });
        let ahead = 1.5 / 1.25_f64.sqrt();
        let velocity_dvl = match expected {
            Some(_) => [ahead, ahead * 0.5, 0.0],
            None => [0.4, -0.1, 0.0],
        };
        for tenth in 0..=50 {
            push(&mut initialiser, f64::from(tenth) * 0.1, &Reading::Dvl { velocity_dvl });
        }
        for second in 0..=5 {
            let way = 1.5 * f64::from(second) / 2.0_f64.sqrt();
            let antenna_enu = [-way, way, 0.0];
            push(&mut initialiser, f64::from(second), &Reading::Gnss { antenna_enu, sigma_enu: [0.02, 0.02, 0.1] });
        }
        let state = initialiser.first_state(Time::from_seconds(5.0), &world()).map(|(state, _)| state);
        match (state, expected) {
            (Some(state), Some(crossing)) => {
                let heading = crate::sensors::McpModel::predicted_heading(&state, &world());
                assert_relative_eq!(heading, crossing - core::f64::consts::FRAC_PI_4, epsilon = 1e-3);
            }
            (state, expected) => assert!(state.is_none() && expected.is_none(), "{state:?}"),
        }
    }
}

#[test]
fn a_turning_vehicle_is_not_taken_for_a_biased_gyroscope() {
    let mut initialiser = Initialiser::new(&config());
    let rate = Vector3::new(0.0, 0.0, 0.01);
    push_imu(&mut initialiser, 3.0, |_| ImuPoint { gyro_body: at_rest().gyro_body + rate, ..at_rest() });
    push(&mut initialiser, 3.0, &Reading::Mcp { heading: HEADING });
    push(&mut initialiser, 3.0, &fix_at(Vector3::zeros()));
    let (state, _) = initialiser.first_state(Time::from_seconds(3.0), &world()).expect("all is there");
    assert_eq!(state.gyro_bias, Vector3::zeros());
}

#[test]
fn a_given_state_of_long_before_the_first_sample_is_left_aside() {
    let at = |t_given: i64| {
        let mut config = config();
        let initial = &mut config.vehicle.initial;
        initial.t = Some(Time(t_given));
        (initial.position_enu, initial.velocity_enu) = (Some([7.0, 8.0, 9.0]), Some([0.0; 3]));
        initial.q_enu_body = Some([1.0, 0.0, 0.0, 0.0]);
        let mut initialiser = Initialiser::new(&config);
        push_imu(&mut initialiser, 3.0, |_| at_rest());
        initialiser.first_state(Time(600 * PERIOD), &world())
    };
    assert!(at(0).is_some() && at(-1_000_000_000).is_some());
    // Nobody has measured where the vehicle is by now.
    assert!(at(-60_000_000_000).is_none());
}

/// Level and straight ahead to the east with `speed`, m/s.
fn riding(initialiser: &mut Initialiser, seconds: f64, speed: Option<f64>) {
    push_imu(initialiser, seconds, |_| ImuPoint {
        gyro_body: world().earth_rate_enu,
        accel_body: -world().gravity.at(&Vector3::zeros()),
    });
    push(initialiser, seconds, &Reading::Mcp { heading: core::f64::consts::FRAC_PI_2 });
    if let Some(speed) = speed {
        push(initialiser, seconds - 0.2, &Reading::Dvl { velocity_dvl: [speed, 0.0, 0.0] });
    }
}

#[test]
fn a_fix_and_a_depth_of_a_while_ago_are_carried_to_the_keyframe() {
    let mut config = config();
    config.vehicle.gnss.lever_arm_body = [0.0; 3];
    let mut initialiser = Initialiser::new(&config);
    riding(&mut initialiser, 4.0, Some(2.0));
    let fix = Reading::Gnss { antenna_enu: [10.0, 5.0, 0.0], sigma_enu: [0.02, 0.02, f64::INFINITY] };
    push(&mut initialiser, 3.0, &fix);
    // What the estimator will use itself is left to it.
    let later = Reading::Gnss { antenna_enu: [99.0, 5.0, 0.0], sigma_enu: [0.02, 0.02, f64::INFINITY] };
    push(&mut initialiser, 4.01, &later);
    push(&mut initialiser, 3.9, &Reading::Ps { depth: 1.5 });
    let (state, covariance) = initialiser.first_state(Time::from_seconds(4.0), &world()).expect("all is there");
    assert_relative_eq!(state.position_enu, Vector3::new(12.0, 5.0, -1.5), epsilon = 2e-3);
    assert_relative_eq!(state.velocity_enu, Vector3::new(2.0, 0.0, 0.0), epsilon = 2e-3);
    // Across by a heading known to 2° over 2 m, and by a tilt known to 3°: g·3° = 0.51 m/s² over the second, ½T², of which the
    // DVL, 0.2 s before the end, takes 0.2T. Up by the depth's own.
    let sigma = |axis: usize| covariance[(axis, axis)].sqrt();
    let across = (2.0 * 2.0_f64.to_radians()).hypot(9.8 * 3.0_f64.to_radians() * (0.5 - 0.2));
    assert_relative_eq!(sigma(1), across, max_relative = 0.05);
    assert!((0.01..0.03).contains(&sigma(2)), "{} m up", sigma(2));
    // The velocity errs by 0.51 m/s² · 0.2 s and by 2° of 2 m/s, with the same two causes.
    let (by_tilt, by_heading) = (9.8 * 3.0_f64.to_radians(), 2.0 * 2.0_f64.to_radians());
    let with_velocity = -by_tilt * by_tilt * (0.5 - 0.2) * 0.2 + by_heading * by_heading;
    assert_relative_eq!(covariance[(1, 4)], with_velocity, max_relative = 0.1);
}

#[test]
fn a_smooth_ride_is_not_taken_for_rest_unless_something_saw_it() {
    let sigma_of = |speed: Option<f64>| {
        let mut initialiser = Initialiser::new(&config());
        riding(&mut initialiser, 4.0, speed);
        push(&mut initialiser, 4.0, &fix_at(Vector3::zeros()));
        let (state, covariance) = initialiser.first_state(Time::from_seconds(4.0), &world()).expect("all is there");
        (state.velocity_enu.x, covariance[(VELOCITY, VELOCITY)].sqrt())
    };
    let (_, unseen) = sigma_of(None);
    assert_relative_eq!(unseen, 1.5, max_relative = 1e-6);
    let (speed, at_rest) = sigma_of(Some(0.0));
    assert!(speed.abs() < 1e-3 && at_rest < 0.02, "{speed} of {at_rest} m/s");
    let (speed, riding) = sigma_of(Some(0.6));
    // Under way tilt is known to 3°: 0.51 m/s² since the DVL spoke, 0.2 s ago.
    assert!((speed - 0.6).abs() < 1e-3 && riding < 0.11, "{speed} of {riding} m/s");
}

#[test]
fn a_vehicle_that_rolls_in_the_swell_is_levelled_as_it_lies_at_the_keyframe() {
    // 10° to each side in 4 s, the keyframe at the greatest roll.
    const AMPLITUDE: f64 = 0.1745;
    let omega = core::f64::consts::FRAC_PI_2;
    let roll = |t: f64| AMPLITUDE * (omega * t).sin();
    let mut initialiser = Initialiser::new(&config());
    push_imu(&mut initialiser, 5.0, |t| ImuPoint {
        gyro_body: Vector3::x() * (AMPLITUDE * omega * (omega * t).cos()),
        accel_body: nalgebra::Rotation3::from_axis_angle(&Vector3::x_axis(), -roll(t)) * Vector3::z() * 9.8,
    });
    push(&mut initialiser, 5.0, &Reading::Mcp { heading: 0.3 });
    push(&mut initialiser, 5.0, &fix_at(Vector3::zeros()));
    let (state, _) = initialiser.first_state(Time::from_seconds(5.0), &world()).expect("all is there");
    let (found, pitch, _) = state.q_enu_body.euler_angles();
    assert!((found - AMPLITUDE).abs() < 1e-3 && pitch.abs() < 1e-3, "roll {found}, pitch {pitch}");
}

#[test]
fn a_heading_read_before_the_keyframe_in_a_turn_is_turned_along() {
    const RATE: f64 = 0.05;
    let mut initialiser = Initialiser::new(&config());
    let turning = ImuPoint { gyro_body: Vector3::z() * RATE, accel_body: Vector3::z() * 9.8 };
    push_imu(&mut initialiser, 4.0, |_| turning);
    push(&mut initialiser, 3.0, &Reading::Mcp { heading: 0.4 });
    push(&mut initialiser, 4.0, &fix_at(Vector3::zeros()));
    let (state, _) = initialiser.first_state(Time::from_seconds(4.0), &world()).expect("all is there");
    // Counter-clockwise by 0.05 rad: a smaller heading.
    let heading = crate::sensors::McpModel::predicted_heading(&state, &world());
    assert!((heading - (0.4 - RATE)).abs() < 1e-4, "{heading}");
}

/// Of 20 s before the samples, 30 m west of the origin, sailing east at 1.5 m/s at 50 m depth.
fn last_known() -> LastKnown {
    let [lat_deg, lon_deg, height] = world().frame.origin().to_degrees();
    let mut solution = shared_types::Solution { origin: [lat_deg, lon_deg, height], ..shared_types::Solution::empty() };
    (solution.position_enu, solution.velocity_enu) = ([-30.0, 0.0, -50.0], [1.5, 0.0, 0.0]);
    (0..6).for_each(|axis| solution.covariance[axis][axis] = 0.01);
    LastKnown::of(&solution, Time::from_seconds(-20.0)).expect("valid")
}

#[test]
fn where_nothing_tells_the_place_the_last_one_known_does_with_the_depth_and_its_age() {
    let t = Time::from_seconds(3.0);
    let mut config = config();
    // The beginning of the mission, long ago.
    config.vehicle.initial.t = Some(Time::from_seconds(17.0));
    config.vehicle.initial.position_enu = Some([700.0, 0.0, 0.0]);
    let mut initialiser = Initialiser::new(&config);
    initialiser.remember(&last_known());
    push_imu(&mut initialiser, 3.0, |_| at_rest());
    push(&mut initialiser, 2.9, &Reading::Mcp { heading: HEADING });
    let depth = config.vehicle.frame.surface_height + 48.0;
    push(&mut initialiser, 2.9, &Reading::Ps { depth });
    let (state, covariance) = initialiser.first_state(t, &world()).expect("all is there");
    // 23 s at 1.5 m/s.
    assert!((state.position_enu.x - 4.5).abs() < 0.1, "{}", state.position_enu);
    assert!((state.position_enu.z + 48.0).abs() < 0.5, "{}", state.position_enu);
    let sigma = |axis: usize| covariance[(axis, axis)].sqrt();
    assert!((40.0..60.0).contains(&sigma(0)), "{} m", sigma(0));
    assert!(sigma(2) < 1.0, "the pressure sensor has spoken: {} m", sigma(2));
    assert!(covariance.cholesky().is_some());
    // A fix knows better.
    push(&mut initialiser, 2.8, &fix_at(Vector3::new(12.0, -7.0, -48.0)));
    let (state, _) = initialiser.first_state(t, &world()).expect("all is there");
    assert!((state.position_enu.xy() - nalgebra::Vector2::new(12.0, -7.0)).norm() < 0.5, "{}", state.position_enu);
}

#[test]
fn a_last_place_that_has_grown_too_old_tells_nothing() {
    let mut initialiser = Initialiser::new(&config());
    initialiser.remember(&last_known());
    let start = 600.0;
    for index in 0..=600 {
        let t = Time::from_seconds(start) + Duration(index * PERIOD);
        let point = at_rest();
        let reading = Reading::Imu { gyro_body: point.gyro_body.into(), accel_body: point.accel_body.into() };
        initialiser.push(&Measurement::new(t, t, &reading));
    }
    push(&mut initialiser, start + 2.9, &Reading::Mcp { heading: HEADING });
    assert!(initialiser.first_state(Time::from_seconds(start + 3.0), &world()).is_none());
}
