//! `sensors.toml` of a simulated log: the facts that the readings were made with.

use std::fmt::Write as _;

use crate::world::Core;

/// The state that the estimation starts from.
pub(crate) struct InitialState {
    pub(crate) position_enu: [f64; 3],
    pub(crate) velocity_enu: [f64; 3],
    pub(crate) q_enu_body: [f64; 4],
}

/// The file. Rust prints the shortest text that reads back to the same bits.
pub(crate) fn sensors_toml(core: &Core, initial: &InitialState) -> String {
    let mut file = String::new();
    // A section is a name, and keys with the text of their values.
    let mut section = |name: &str, keys: &[(&str, String)]| {
        let separator = if file.is_empty() { "" } else { "\n" };
        writeln!(file, "{separator}[{name}]").expect("writing to a String does not fail");
        for (key, value) in keys {
            writeln!(file, "{key} = {value}").expect("writing to a String does not fail");
        }
    };
    let (scenario, noise) = (&core.scenario, &core.noise);
    section("frame", &[("origin", array(&scenario.origin_deg)), ("surface_height", number(scenario.surface_height))]);
    section(
        "initial",
        &[
            ("t", number(scenario.initial.t)),
            ("position", array(&initial.position_enu)),
            ("velocity", array(&initial.velocity_enu)),
            ("quaternion", array(&initial.q_enu_body)),
            ("sigma_position", number(scenario.initial.sigma_position)),
            ("sigma_velocity", number(scenario.initial.sigma_velocity)),
            ("sigma_attitude", array(&scenario.initial.sigma_attitude_deg)),
        ],
    );
    if scenario.imu.is_some() {
        section(
            "imu",
            &[
                ("gyro_noise_density", number(noise.gyro_noise_density)),
                ("accel_noise_density", number(noise.accel_noise_density)),
                ("gyro_bias_random_walk", number(noise.gyro_bias_random_walk)),
                ("accel_bias_random_walk", number(noise.accel_bias_random_walk)),
                ("gyro_bias_sigma", number(noise.gyro_bias_sigma)),
                ("accel_bias_sigma", number(noise.accel_bias_sigma)),
            ],
        );
    }
    if let Some(lbl) = &scenario.lbl {
        section(
            "lbl",
            &[
                ("sigma", number(noise.lbl_sigma)),
                ("lever_arm", array(&lbl.lever_arm_body)),
                ("reference_buoy", lbl.reference_buoy.to_string()),
                ("buoy_sigma", number(scenario.buoys.sigma)),
            ],
        );
    }
    if let Some(gnss) = &scenario.gnss {
        section("gnss", &[("sigma", array(&noise.gnss_sigma_enu)), ("lever_arm", array(&gnss.lever_arm_body))]);
    }
    if let Some(dvl) = &scenario.dvl {
        section(
            "dvl",
            &[
                ("sigma", number(noise.dvl_sigma)),
                ("lever_arm", array(&dvl.lever_arm_body)),
                ("mounting_rpy", array(&dvl.mounting_rpy_deg)),
            ],
        );
    }
    if let Some(mcp) = &scenario.mcp {
        section("mcp", &[("sigma", number(noise.mcp_sigma_deg)), ("declination", number(mcp.declination_deg))]);
    }
    if let Some(ps) = &scenario.ps {
        section("ps", &[("sigma", number(noise.ps_sigma)), ("lever_arm", array(&ps.lever_arm_body))]);
    }
    file
}

/// `{:?}` writes 1.0 as a float, which TOML then takes for one.
fn number(value: f64) -> String {
    format!("{value:?}")
}

fn array(values: &[f64]) -> String {
    format!("{values:?}")
}
