//! Scores of motions whose errors are known in closed form.

use nalgebra::{UnitQuaternion, Vector3};
use nav_evaluation::{EstimatePoint, Score, Scorer, Window};
use nav_geometry::wgs84::{meridian_radius, prime_vertical_radius};
use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{Header, Time, Truth};

const ESTIMATE_PERIOD: i64 = 5_000_000;
const TRUTH_PERIOD: i64 = 103_000_000;

fn origin() -> Geodetic {
    Geodetic::from_degrees(36.38, 127.36, 0.0)
}

/// Nose down by 0.2 rad, heading between east and north.
fn attitude() -> UnitQuaternion<f64> {
    UnitQuaternion::from_euler_angles(0.1, 0.2, 0.7)
}

/// 0.6 m/s east and 0.8 m/s north, 10 m under the ellipsoid. Given as geodetic, so that the way to ENU is the exact one.
fn geodetic(nanos: i64) -> Geodetic {
    const HEIGHT: f64 = -10.0;
    let start = origin();
    let t = Time(nanos).as_seconds();
    let parallel = (prime_vertical_radius(start.latitude) + HEIGHT) * start.latitude.cos();
    let meridian = meridian_radius(start.latitude) + HEIGHT;
    Geodetic::new(start.latitude + 0.8 * t / meridian, start.longitude + 0.6 * t / parallel, HEIGHT)
}

fn truth(nanos: i64) -> Truth {
    let [lat_deg, lon_deg, height] = geodetic(nanos).to_degrees();
    let q = attitude();
    Truth {
        header: Header::at(Time(nanos)),
        lat_deg,
        lon_deg,
        height,
        q_enu_body: [q.w, q.i, q.j, q.k],
        velocity_enu: [0.6, 0.8, 0.0],
    }
}

fn estimate(nanos: i64) -> EstimatePoint {
    EstimatePoint {
        t: Time(nanos),
        position_enu: LocalFrame::new(origin()).to_enu(&geodetic(nanos)),
        velocity_enu: Vector3::new(0.6, 0.8, 0.0),
        q_enu_body: attitude(),
        sigma_position_enu: Vector3::new(0.1, 0.2, 0.3),
        sigma_velocity_enu: Vector3::repeat(0.01),
        sigma_rpy: Vector3::repeat(1e-3),
    }
}

/// Ten seconds, scored as `estimate` says.
fn score_of(window: Window, estimate: impl Fn(i64) -> Option<EstimatePoint>, truth: impl Fn(i64) -> Truth) -> Score {
    let mut scorer = Scorer::new(origin(), window);
    let mut next_truth = -3 * TRUTH_PERIOD;
    for nanos in (0..=2000).map(|index| index * ESTIMATE_PERIOD) {
        while next_truth <= nanos {
            scorer.truth(&truth(next_truth));
            next_truth += TRUTH_PERIOD;
        }
        if let Some(estimate) = estimate(nanos) {
            scorer.estimate(&estimate);
        }
    }
    scorer.score().expect("truth and estimates overlap")
}

#[test]
fn a_perfect_estimate_has_no_error() {
    let score = score_of(Window::default(), |t| Some(estimate(t)), truth);
    // Truth rows from 0 to 9.991 s.
    assert_eq!((score.samples, score.missed), (98, 0));
    assert!(score.rms_3d < 1e-8, "{score:?}");
    assert!(score.ate_aligned < 1e-6, "{score:?}");
    assert_eq!(score.attitude_rms_deg.map(|rms| rms.iter().all(|&x| x < 1e-9)), Some(true));
    assert_eq!(score.three_sigma_share_enu, Some([1.0; 3]));
    assert!((score.distance_m - score.duration_s).abs() < 1e-4, "1 m/s: {score:?}");
    assert!((score.duration_s - 97.0 * 0.103).abs() < 1e-9);
}

#[test]
fn a_constant_offset_is_its_rms_and_vanishes_when_aligned() {
    let offset = Vector3::new(0.3, -0.4, 0.6);
    let score = score_of(
        Window::default(),
        |t| Some(EstimatePoint { position_enu: estimate(t).position_enu + offset, ..estimate(t) }),
        truth,
    );
    for axis in 0..3 {
        assert!((score.rms_enu[axis] - offset[axis].abs()).abs() < 1e-8, "{score:?}");
        assert!((score.max_enu[axis] - offset[axis].abs()).abs() < 1e-8);
        assert!((score.final_error_enu[axis] - offset[axis]).abs() < 1e-8, "estimate minus truth");
    }
    assert!((score.rms_horizontal - 0.5).abs() < 1e-8 && (score.max_horizontal - 0.5).abs() < 1e-8);
    assert!((score.rms_3d - 0.61_f64.sqrt()).abs() < 1e-8);
    // (0.3/0.1)² = 9, (0.4/0.2)² = 4, (0.6/0.3)² = 4.
    let nees = score.nees_enu.expect("sigmas are known");
    assert!((nees[0] - 9.0).abs() < 1e-5 && (nees[1] - 4.0).abs() < 1e-5 && (nees[2] - 4.0).abs() < 1e-5);
    assert!((score.nees_position.expect("likewise") - 17.0).abs() < 1e-5);
    assert!(score.ate_aligned < 1e-6, "{score:?}");
}

#[test]
fn errors_beyond_three_sigmas_lower_the_share_of_their_axis_alone() {
    let score = score_of(
        Window::default(),
        |t| {
            let off = if t >= 5_000_000_000 { 0.31 } else { 0.29 };
            Some(EstimatePoint { position_enu: estimate(t).position_enu + Vector3::new(off, off, off), ..estimate(t) })
        },
        truth,
    );
    let share = score.three_sigma_share_enu.expect("sigmas are known");
    // 49 of the 98 rows lie before 5 s.
    assert_eq!(share, [0.5, 1.0, 1.0]);
}

#[test]
fn attitude_errors_are_about_body_x_body_y_and_the_up_axis() {
    let about = |axis: Vector3<f64>| {
        let score = score_of(
            Window::default(),
            |t| {
                Some(EstimatePoint {
                    q_enu_body: UnitQuaternion::from_scaled_axis(axis * 0.01) * attitude(),
                    ..estimate(t)
                })
            },
            truth,
        );
        score.attitude_rms_deg.expect("the truth has an attitude").map(f64::to_radians)
    };
    // Turned about a world axis: about up, it is all yaw, and what is left of it about the tilted body axes.
    let up_body = attitude().inverse() * Vector3::z();
    let [roll, pitch, yaw] = about(Vector3::z());
    assert!((yaw - 0.01).abs() < 1e-9 && (roll - 0.01 * up_body.x.abs()).abs() < 1e-9);
    assert!((pitch - 0.01 * up_body.y.abs()).abs() < 1e-9);
    // Turned about body x.
    let [roll, pitch, yaw] = about(attitude() * Vector3::x());
    assert!((roll - 0.01).abs() < 1e-9 && pitch < 1e-9);
    assert!((yaw - 0.01 * (attitude() * Vector3::x()).z.abs()).abs() < 1e-9);
}

#[test]
fn a_truth_north_of_the_origin_makes_an_estimate_at_the_origin_err_to_the_south() {
    let mut scorer = Scorer::new(origin(), Window::default());
    scorer.truth(&Truth { lat_deg: 36.38 + 1e-5, lon_deg: 127.36, height: 0.0, ..truth(0) });
    scorer.estimate(&EstimatePoint { position_enu: Vector3::zeros(), ..estimate(0) });
    let error = scorer.score().expect("they have the time in common").final_error_enu;
    // 1e-5 degrees of the meridian at that latitude: 6 357 887 m · π/180 · 1e-5.
    assert!((error[1] + 1.109_661).abs() < 1e-5 && error[0].abs() < 1e-6 && error[2].abs() < 1e-6, "{error:?}");
}

#[test]
fn velocity_errors_and_their_sigmas_count_per_axis() {
    let score = score_of(
        Window::default(),
        |t| Some(EstimatePoint { velocity_enu: Vector3::new(0.62, 0.8, 0.04), ..estimate(t) }),
        truth,
    );
    let rms = score.velocity_rms_enu.expect("the truth has a velocity");
    assert!((rms[0] - 0.02).abs() < 1e-12 && rms[1] < 1e-12 && (rms[2] - 0.04).abs() < 1e-12);
    assert_eq!(score.three_sigma_share_velocity_enu, Some([1.0, 1.0, 0.0]));
}

#[test]
fn what_the_truth_does_not_report_is_not_scored() {
    let without_attitude = |t| Truth { q_enu_body: [f64::NAN; 4], velocity_enu: [f64::NAN; 3], ..truth(t) };
    let score = score_of(Window::default(), |t| Some(estimate(t)), without_attitude);
    assert_eq!((score.attitude_rms_deg, score.velocity_rms_enu), (None, None));
    assert!(score.rms_3d < 1e-8 && score.samples == 98);
}

#[test]
fn a_gap_in_the_estimates_is_counted_as_missed() {
    let score =
        score_of(Window::default(), |t| (!(4_000_000_000..6_000_000_000).contains(&t)).then(|| estimate(t)), truth);
    // Rows strictly between 3.995 s and 6 s: 39 (4.017 s) to 58 (5.974 s).
    assert_eq!((score.samples, score.missed), (78, 20));
}

#[test]
fn only_the_window_is_scored() {
    let window = Window { from: Time(2_000_000_000), to: Time(3_000_000_000) };
    let score = score_of(window, |t| Some(estimate(t)), truth);
    // Rows 20 (2.06 s) to 29 (2.987 s).
    assert_eq!(score.samples, 10);
    assert!((score.t_first_s - 2.06).abs() < 1e-9 && (score.t_last_s - 2.987).abs() < 1e-9);
}

#[test]
fn without_a_common_time_there_is_no_score() {
    let mut scorer = Scorer::new(origin(), Window::default());
    scorer.truth(&truth(0));
    scorer.estimate(&estimate(10_000_000));
    assert_eq!(scorer.score(), None);
}
