//! Golden numbers of §8.5, forward and backward, and every Jacobian against central differences.

use approx::assert_relative_eq;
use nalgebra::{Matrix3, Vector3};
use shared_types::{Dvl, Gnss, Lbl, Mcp, Vehicle};

use super::*;
use crate::anchor::Anchor;
use crate::anchored::{Anchored, Pose, SensorModel};
use crate::preintegration::{Piece, Preintegration};
use crate::state::{GYRO_BIAS, NavState, POSITION};
use crate::testing::{
    check_anchored_jacobian, check_anchored_jacobian_where, fingerprint, golden_from, golden_piece, golden_sample,
    golden_to, noise, world,
};
use crate::transport::transport;

const LEVER_ARM: [f64; 3] = [0.4, -0.15, 0.25];

fn anchor(state: &NavState) -> Anchor {
    Anchor::new(state, &world())
}

fn lbl(sigma: f64) -> Lbl {
    Lbl { sigma, lever_arm_body: LEVER_ARM, reference_buoy: 1, buoy_sigma: 0.0 }
}

fn golden_lbl() -> LblModel {
    LblModel { range_scale: 0.0008, ..LblModel::new(620.0, [-400.0, 0.0, 0.0], 0.0, &lbl(0.3)) }
}

fn golden_gnss() -> GnssModel {
    let gnss = Gnss { sigma_enu: [1.0; 3], lever_arm_body: LEVER_ARM };
    GnssModel::new([120.5, -340.1, -54.6], [0.02; 3], &gnss, &world())
}

fn golden_dvl() -> DvlModel {
    let dvl = Dvl { sigma: 0.01, lever_arm_body: LEVER_ARM, mounting_rpy: [0.02, -0.03, 0.5] };
    let model = DvlModel::new([1.0, -1.2, 0.3], golden_sample(2.5).gyro_body, &dvl, &noise(), 0.1);
    // The table leaves out the noise of the gyroscope sample.
    let mut model = model.with_covariance(Matrix3::identity() * 1e-4);
    model.scale = 0.004;
    model
}

fn golden_mcp() -> McpModel {
    McpModel::new(22.0_f64.to_radians(), &Mcp { sigma: 0.01_f64.to_radians(), declination: 0.0 })
}

fn golden_ps() -> PsModel {
    PsModel { depth: 55.2, lever_arm_body: Vector3::from(LEVER_ARM), surface_height: 0.7, sigma: 0.01 }
}

/// State, piece and the two columns of the table.
fn both_ways() -> [(NavState, Preintegration); 2] {
    [(golden_from(), golden_piece(&[0.0, 0.1, 0.2, 0.25])), (golden_to(), golden_piece(&[0.5, 0.4, 0.3, 0.25]))]
}

struct Row<const ROWS: usize> {
    residual: [f64; ROWS],
    /// s and F.
    jacobian: (f64, f64),
    sigma: Option<[f64; ROWS]>,
}

fn check<const ROWS: usize>(model: &impl SensorModel<ROWS>, tolerance: f64, golden: [Row<ROWS>; 2]) {
    for ((state, piece), golden) in both_ways().into_iter().zip(golden) {
        let anchored = Anchored::new(model, &anchor(&state), &piece, &world());
        let covariance = anchored.inflated_covariance(&Piece::Forward(&piece));
        for row in 0..ROWS {
            assert_relative_eq!(anchored.residual[row], golden.residual[row], epsilon = tolerance);
            if let Some(sigma) = golden.sigma {
                assert_relative_eq!(covariance[(row, row)].sqrt(), sigma[row], max_relative = 1e-10);
            }
        }
        let (s, f) = fingerprint(&anchored.jacobian);
        assert_relative_eq!(s, golden.jacobian.0, max_relative = 1e-9);
        assert_relative_eq!(f, golden.jacobian.1, max_relative = 1e-9);
    }
}

#[test]
fn golden_gnss_is_met() {
    let golden = [
        Row {
            residual: [0.227544824411, 0.0225809643788, -0.0474595701186],
            jacobian: (1.28906403112, 2.05875018939),
            sigma: Some([0.0200001267919, 0.0200001273388, 0.020000126513]),
        },
        Row {
            residual: [0.154687825195, 0.0812215429124, 0.0148646306399],
            jacobian: (0.98698662662, 2.0508547911),
            sigma: Some([0.0200001269358, 0.0200001272559, 0.0200001264522]),
        },
    ];
    check(&golden_gnss(), 1e-9, golden);
}

#[test]
fn golden_dvl_is_met() {
    let golden = [
        Row {
            residual: [-1.87069889182, -0.353425866225, 0.255279856128],
            jacobian: (0.185005000316, 4.45957045795),
            sigma: Some([0.0100126275444, 0.0100126107309, 0.0100126303708]),
        },
        Row {
            residual: [-0.844293100875, -0.844955066784, -0.0186000324723],
            jacobian: (4.14868210103, 5.31809704941),
            sigma: Some([0.0100126619901, 0.0100126189893, 0.010012635795]),
        },
    ];
    check(&golden_dvl(), 1e-10, golden);
    let columns =
        [[0.202563942363, -0.37927107585, 0.0831592041328], [0.291698543465, -0.528793979963, -0.840536331329]];
    for ((state, piece), expected) in both_ways().into_iter().zip(columns) {
        let jacobian = Anchored::new(&golden_dvl(), &anchor(&state), &piece, &world()).jacobian;
        for (axis, expected) in expected.into_iter().enumerate() {
            assert_relative_eq!(jacobian[(0, GYRO_BIAS + axis)], expected, max_relative = 1e-10);
        }
    }
}

#[test]
fn golden_mcp_is_met() {
    for ((state, piece), heading_deg) in both_ways().into_iter().zip([37.2191512964, 36.6031153321]) {
        let at_reading = transport(&state, &piece, &world());
        assert_relative_eq!(
            McpModel::predicted_heading(&at_reading, &world()).to_degrees(),
            heading_deg,
            epsilon = 1e-9
        );
    }
    let golden = [
        (
            [0.265624299482],
            [0.0544732066596, -0.129876540833, -1.0169937194],
            [-0.00657030485368, 0.0362041855712, 0.253983694292],
        ),
        (
            [0.254872443593],
            [-0.0319119492471, -0.0120609217106, -1.01482391105],
            [-0.00418205863577, 0.00130549097307, -0.253789251898],
        ),
    ];
    for ((state, piece), (residual, attitude, gyro)) in both_ways().into_iter().zip(golden) {
        let anchored = Anchored::new(&golden_mcp(), &anchor(&state), &piece, &world());
        assert_relative_eq!(anchored.residual[0], residual[0], epsilon = 1e-11);
        for axis in 0..3 {
            assert_relative_eq!(anchored.jacobian[6 + axis], attitude[axis], max_relative = 1e-10);
            assert_relative_eq!(anchored.jacobian[12 + axis], gyro[axis], max_relative = 1e-9);
        }
    }
}

#[test]
fn golden_ps_is_met() {
    let golden = [
        Row { residual: [0.13722302934], jacobian: (1.0313868225, 1.09826477321), sigma: None },
        Row { residual: [0.0749033421027], jacobian: (0.679952216741, 1.0835902304), sigma: None },
    ];
    check(&golden_ps(), 1e-8, golden);
    let (state, piece) = both_ways()[0];
    let jacobian = Anchored::new(&golden_ps(), &anchor(&state), &piece, &world()).jacobian;
    let expected = Vector3::new(-1.89062020291e-5, 5.34895377443e-5, -0.999999998391);
    assert_relative_eq!(jacobian.fixed_columns::<3>(POSITION).transpose(), expected, epsilon = 1e-12);
}

#[test]
fn golden_lbl_is_met() {
    let golden = [
        Row { residual: [4.83605454435], jacobian: (2.08937120577, 1.24603624676), sigma: None },
        Row { residual: [4.73781527074], jacobian: (1.89842601129, 1.25062006873), sigma: None },
    ];
    check(&golden_lbl(), 1e-9, golden);
    let directions = [
        (624.336585276, [0.834049384747, -0.544702051835, -0.0875288439904]),
        (624.238424531, [0.834063824598, -0.544693766188, -0.0874427674175]),
    ];
    for ((state, piece), (distance, direction)) in both_ways().into_iter().zip(directions) {
        let (found, u) = golden_lbl().distance_and_direction(&Pose::from(&transport(&state, &piece, &world())));
        assert_relative_eq!(found, distance, epsilon = 1e-8);
        assert_relative_eq!(u, Vector3::from(direction), epsilon = 1e-11);
    }
}

// The transport's Jacobian holds gravity constant: 4e-6 over a second; PS and LBL see it through position alone.
const GRAVITY_HELD: f64 = 4e-6;

#[test]
fn lbl_jacobian_agrees_with_central_differences() {
    check_anchored_jacobian(11, GRAVITY_HELD, |_| golden_lbl());
}

#[test]
fn gnss_jacobian_agrees_with_central_differences() {
    check_anchored_jacobian(12, GRAVITY_HELD, |_| golden_gnss());
    let gnss = Gnss { sigma_enu: [1.0; 3], lever_arm_body: LEVER_ARM };
    let flat = GnssModel::new([120.5, -340.1, -54.6], [0.02, 0.02, f64::INFINITY], &gnss, &world());
    check_anchored_jacobian(12, GRAVITY_HELD, |_| flat);
}

#[test]
fn dvl_jacobian_agrees_with_central_differences() {
    check_anchored_jacobian(13, 2.0 * GRAVITY_HELD, |_| golden_dvl());
}

#[test]
fn mcp_jacobian_agrees_with_central_differences() {
    // ∂ψ/∂p = tan φ/N is left out; steep states bend within the step of the differentiator. The measured heading is near the predicted one, away from the wrap.
    check_anchored_jacobian_where(14, 1e-5, |state| {
        let heading = McpModel::predicted_heading(state, &world()) + 0.3;
        McpModel::is_usable(state, &world()).then_some(McpModel { heading, sigma: 0.01 })
    });
}

#[test]
fn ps_jacobian_agrees_with_central_differences() {
    check_anchored_jacobian(15, GRAVITY_HELD, |_| golden_ps());
}

#[test]
fn a_deeper_vehicle_predicts_a_greater_depth() {
    let shallow = golden_from();
    let mut deep = shallow;
    deep.position_enu.z -= 2.0;
    let change = golden_ps().see(&Pose::from(&deep), &world()).residual
        - golden_ps().see(&Pose::from(&shallow), &world()).residual;
    assert_relative_eq!(change[0], 2.0, epsilon = 1e-8);
}

#[test]
fn a_right_turn_makes_the_heading_grow_and_the_residual_wraps() {
    let state = golden_from();
    let model = McpModel { heading: McpModel::predicted_heading(&state, &world()), sigma: 0.01 };
    let mut turned = state;
    turned.q_enu_body = nalgebra::UnitQuaternion::from_euler_angles(0.0, 0.0, -0.1) * state.q_enu_body;
    // About the up axis of the origin, 8e-5 rad from that of the vehicle.
    assert_relative_eq!(model.see(&Pose::from(&turned), &world()).residual[0], 0.1, epsilon = 1e-5);
    let opposite = McpModel { heading: model.heading + 2.0 * std::f64::consts::PI - 0.1, ..model };
    assert_relative_eq!(opposite.see(&Pose::from(&state), &world()).residual[0], 0.1, epsilon = 1e-12);
    assert_relative_eq!(mcp::wrap(-std::f64::consts::PI), std::f64::consts::PI);
}

#[test]
fn a_heading_near_the_vertical_is_not_usable_and_its_sigma_grows_before() {
    let pitched = |pitch: f64| NavState {
        q_enu_body: nalgebra::UnitQuaternion::from_euler_angles(0.3, -pitch, 1.0),
        ..golden_from()
    };
    let model = golden_mcp();
    assert!(McpModel::is_usable(&pitched(1.3), &world()));
    assert!(!McpModel::is_usable(&pitched(1.4), &world()));
    let ratio = model.see(&Pose::from(&pitched(1.2)), &world()).covariance[0]
        / model.see(&Pose::from(&pitched(0.0)), &world()).covariance[0];
    assert_relative_eq!(ratio.sqrt(), 1.0 / 1.2_f64.cos(), max_relative = 1e-3);
}

/// What settles most cases at a glance must never settle one otherwise than the vertical at the vehicle does.
#[test]
fn a_heading_is_usable_by_the_vertical_at_the_vehicle_however_far_from_the_origin() {
    let world = world();
    let (mut usable, mut unusable, mut between) = (0, 0, 0);
    for k in 0..4000 {
        let [a, b, c] = [0.7, 1.9, 0.013].map(|rate| f64::from(k) * rate);
        let mut state = NavState::identity();
        state.position_enu = Vector3::new(a.sin(), a.cos(), 0.0) * (1.5e6 * c.sin().powi(2));
        // Nose up or down, around the limit of 78 degrees from level.
        let pitch = 1.369 + 0.25 * b.sin();
        state.q_enu_body =
            nalgebra::UnitQuaternion::from_euler_angles(0.3 * a, if k % 2 == 0 { pitch } else { -pitch }, b);
        let level = world.frame.east_and_north_at(&state.position_enu).map(|axis| state.r_enu_body().tr_mul(&axis).x);
        let cosine = level[0].hypot(level[1]);
        // At the limit itself rounding decides.
        if (cosine - 0.2).abs() > 1e-9 {
            assert_eq!(McpModel::is_usable(&state, &world), cosine > 0.2, "{k}: cosine of pitch {cosine}");
        }
        usable += usize::from(cosine > 0.25);
        unusable += usize::from(cosine < 0.15);
        between += usize::from((0.18..0.22).contains(&cosine));
    }
    assert!(usable.min(unusable).min(between) > 100, "{usable} {unusable} {between}");
}

#[test]
fn meridian_convergence_is_that_of_the_method() {
    // E·tan φ/N per kilometre east at 36°: 0.0066°.
    let east = NavState { position_enu: Vector3::new(1000.0, 0.0, 0.0), ..NavState::identity() };
    let change =
        McpModel::predicted_heading(&east, &world()) - McpModel::predicted_heading(&NavState::identity(), &world());
    assert_relative_eq!(change.to_degrees().abs(), 0.0066, epsilon = 1e-4);
}

#[test]
fn a_component_that_was_not_reported_says_nothing() {
    let gnss = Gnss { sigma_enu: [1.0; 3], lever_arm_body: [0.0; 3] };
    let model = GnssModel::new([100.0, 200.0, 1e6], [2.0, 3.0, f64::INFINITY], &gnss, &world());
    assert_eq!(model.components(), 2);
    let state = NavState { position_enu: Vector3::new(101.0, 202.0, -40.0), ..NavState::identity() };
    let residual = model.see(&Pose::from(&state), &world()).residual;
    assert_eq!((residual[2], model.see(&Pose::from(&state), &world()).jacobian.row(2).norm()), (0.0, 0.0));
    let covariance = model.see(&Pose::from(&state), &world()).covariance;
    assert_eq!((covariance[(0, 0)], covariance[(1, 1)], covariance[(2, 2)]), (4.0, 9.0, 1.0));
}

#[test]
fn a_fix_far_away_has_its_sigmas_along_its_own_axes() {
    let gnss = Gnss { sigma_enu: [1.0; 3], lever_arm_body: [0.0; 3] };
    let position = [60_000.0, -80_000.0, -780.0];
    let model = GnssModel::new(position, [1.0, 2.0, 5.0], &gnss, &world());
    let axes = world().frame.local_axes_at(&Vector3::from(position));
    let local = axes.transpose() * model.see(&Pose::from(&NavState::identity()), &world()).covariance * axes;
    assert_relative_eq!(local, Matrix3::from_diagonal(&Vector3::new(1.0, 4.0, 25.0)), epsilon = 1e-12);
    assert!((axes - Matrix3::identity()).norm() > 1e-2);
}

#[test]
fn the_gyroscope_sample_adds_to_the_dvl_where_it_moves_the_lever_arm() {
    let dvl = Dvl { sigma: 0.01, lever_arm_body: [2.0, 0.0, 0.0], mounting_rpy: [0.0; 3] };
    let imu = shared_types::ImuNoise { gyro_noise_density: 1e-3, ..noise() };
    let covariance = DvlModel::new([0.0; 3], Vector3::zeros(), &dvl, &imu, 0.005)
        .see(&Pose::from(&NavState::identity()), &world())
        .covariance;
    let gyro_variance = 1e-6 / 0.005;
    let expected = Matrix3::from_diagonal(&Vector3::new(1e-4, 1e-4 + 4.0 * gyro_variance, 1e-4 + 4.0 * gyro_variance));
    assert_relative_eq!(covariance, expected, epsilon = 1e-15);
}

#[test]
fn a_buoy_of_unsure_position_makes_an_unsure_range() {
    let model = LblModel::new(600.0, [0.0; 3], 0.4, &lbl(0.3));
    assert_relative_eq!(model.see(&Pose::from(&golden_from()), &world()).covariance[0], 0.25, epsilon = 1e-15);
}

#[test]
fn at_the_keyframe_anchoring_is_the_model_itself() {
    let (state, empty) = (golden_from(), Preintegration::new(golden_from().accel_bias, golden_from().gyro_bias));
    let transported = Anchored::new(&golden_dvl(), &anchor(&state), &empty, &world());
    let direct = Anchored::at_keyframe(&golden_dvl(), &Pose::from(&state), &world());
    assert_relative_eq!(transported.residual, direct.residual, epsilon = 1e-14);
    assert_relative_eq!(transported.jacobian, direct.jacobian, epsilon = 1e-14);
    let inflated = transported.inflated_covariance(&Piece::Forward(&empty));
    assert_relative_eq!(inflated, direct.covariance, epsilon = 1e-18);
}

#[test]
fn vehicle_facts_reach_the_models() {
    let vehicle = Vehicle::default();
    assert_eq!(PsModel::new(3.0, &vehicle).surface_height, vehicle.frame.surface_height);
    assert_eq!(McpModel::new(0.1, &vehicle.mcp).sigma, vehicle.mcp.sigma);
}

#[test]
fn residuals_change_with_a_correction_as_their_calibration_jacobians_say() {
    const STEP: f64 = 1e-4;
    let pose = Pose::from(&golden_from());
    let (lbl, dvl) = (golden_lbl(), golden_dvl());
    let corrected = |by: f64| {
        let (mut lbl, mut dvl) = (Model::Lbl(lbl), Model::Dvl(dvl));
        lbl.correct(by);
        dvl.correct(by);
        let (Model::Lbl(lbl), Model::Dvl(dvl)) = (lbl, dvl) else { unreachable!("a correction keeps the sensor") };
        (lbl.see(&pose, &world()).residual, dvl.see(&pose, &world()).residual)
    };
    let (above, below) = (corrected(STEP), corrected(-STEP));
    let by_lbl = lbl.calibration_jacobian(&lbl.see(&pose, &world()).residual);
    let by_dvl = dvl.calibration_jacobian(&dvl.see(&pose, &world()).residual);
    assert_relative_eq!(by_lbl, (above.0 - below.0) / (2.0 * STEP), max_relative = 1e-8);
    assert_relative_eq!(by_dvl, (above.1 - below.1) / (2.0 * STEP), max_relative = 1e-8);
}

/// The residual's rate against that of the residual itself when the reading is taken a little later and earlier, at the
/// keyframe and away from it, forward and backward.
fn check_rate<const ROWS: usize>(model: &impl SensorModel<ROWS>, tolerance: f64) {
    const STEP: f64 = 1e-3;
    let point = golden_sample(2.5);
    for (state, piece) in both_ways() {
        for piece in [piece, Preintegration::new(piece.accel_bias, piece.gyro_bias)] {
            // At the biases of the piece, to which nothing has to be corrected.
            let state = NavState { accel_bias: piece.accel_bias, gyro_bias: piece.gyro_bias, ..state };
            let residual_after = |dt: f64| {
                let mut moved = piece;
                moved.step_mean(dt, &point, &point);
                Anchored::new(model, &anchor(&state), &moved, &world()).residual
            };
            let numeric = (residual_after(STEP) - residual_after(-STEP)) / (2.0 * STEP);
            let analytic = if piece.dt_total == 0.0 {
                Anchored::at_keyframe(model, &Pose::from(&state), &world()).rate(
                    &anchor(&state),
                    None,
                    &point,
                    &world(),
                )
            } else {
                Anchored::new(model, &anchor(&state), &piece, &world()).rate(
                    &anchor(&state),
                    Some(&piece),
                    &point,
                    &world(),
                )
            };
            for row in 0..ROWS {
                assert_relative_eq!(analytic[row], numeric[row], epsilon = tolerance);
            }
        }
    }
}

#[test]
fn residuals_change_with_the_time_of_the_reading_as_their_rate_says() {
    // The turn of the Earth over the piece is left out: 7e-5 rad/s of the velocity and of gravity over half a second.
    check_rate(&golden_lbl(), 1e-3);
    check_rate(&golden_gnss(), 1e-3);
    check_rate(&golden_dvl(), 1e-3);
    check_rate(&golden_mcp(), 1e-4);
    check_rate(&golden_ps(), 1e-3);
}
