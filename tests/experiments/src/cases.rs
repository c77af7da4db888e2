//! The rows of the accuracy table.

use sim_world::Preset;

/// One row.
pub struct Case {
    /// In the table.
    pub name: &'static str,
    /// Built-in scenario.
    pub scenario: &'static str,
    /// Sensor errors.
    pub preset: Preset,
    /// `section.key=value`.
    pub sets: &'static [&'static str],
    /// Depends on no seed: one run says everything.
    pub exact: bool,
}

const NO_DVL_MCP_GNSS: [&str; 3] = ["dvl.enabled=false", "mcp.enabled=false", "gnss.enabled=false"];
const DIFFERENCES: [&str; 4] =
    [NO_DVL_MCP_GNSS[0], NO_DVL_MCP_GNSS[1], NO_DVL_MCP_GNSS[2], "lbl.common_offset_sigma=inf"];

/// Every row, in the order of the table.
pub const CASES: &[Case] = &[
    Case { name: "noise-free, all sensors", scenario: "mission", preset: Preset::None, sets: &[], exact: true },
    Case {
        name: "noise-free, all sensors, PF",
        scenario: "mission",
        preset: Preset::None,
        // The detector would take what PF does to a stamp for a late clock, and mend a part of it.
        sets: &[
            "keyframes.anchor=pf",
            "lbl.time_offset=off",
            "gnss.time_offset=off",
            "dvl.time_offset=off",
            "mcp.time_offset=off",
            "ps.time_offset=off",
            "lbl.calibrate=false",
        ],
        exact: true,
    },
    Case { name: "all sensors", scenario: "mission", preset: Preset::Paper, sets: &[], exact: false },
    Case { name: "all sensors", scenario: "mission", preset: Preset::Realistic, sets: &[], exact: false },
    Case { name: "LBL raw + PS", scenario: "mission", preset: Preset::Realistic, sets: &NO_DVL_MCP_GNSS, exact: false },
    Case {
        name: "LBL differences + PS",
        scenario: "mission",
        preset: Preset::Realistic,
        sets: &DIFFERENCES,
        exact: false,
    },
    Case { name: "LBL raw + PS", scenario: "mission", preset: Preset::Paper, sets: &NO_DVL_MCP_GNSS, exact: false },
    Case { name: "LBL differences + PS", scenario: "mission", preset: Preset::Paper, sets: &DIFFERENCES, exact: false },
    Case { name: "stable, all sensors", scenario: "stable", preset: Preset::Realistic, sets: &[], exact: false },
    Case { name: "outage, all sensors", scenario: "outage", preset: Preset::Realistic, sets: &[], exact: false },
];
