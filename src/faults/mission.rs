//! The mission that is sailed meanwhile: the built-in `stable` one at the surface, so that there are satellites too and a
//! solver that has lost everything can begin anew.

use std::fs;
use std::path::{Path, PathBuf};

use shared_types::Time;
use toml::{Table, Value};

const STABLE: &str = include_str!("../../deploy/scenarios/stable.toml");

const GNSS: &str = "[gnss]\nrate = 1.0\nphase = 0.6142\nlever_arm = [-0.4, 0.1, 0.5]\n";

/// Data time at which a set starts: the estimation of `stable` starts at 17 s.
pub(super) const START: Time = Time(16_500_000_000);

/// Data time at which a set is stopped and another begins: restarted emulators go through the whole mission so far.
pub(super) const END: Time = Time(400_000_000_000);

/// Writes the scenario into the folder, if it is not there yet.
pub(super) fn write(folder: &Path) -> std::io::Result<PathBuf> {
    let file = folder.join("faults.toml");
    if !file.exists() {
        fs::write(&file, text())?;
    }
    Ok(file)
}

fn text() -> String {
    let mut scenario: Table = toml::from_str(STABLE).expect("a test parses every built-in scenario");
    let gnss: Table = toml::from_str(GNSS).expect("a test parses it");
    scenario.extend(gnss);
    scenario["vehicle"]["start"] = Value::Array([0.0; 3].map(Value::Float).into());
    scenario.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_a_scenario_with_satellites_that_lasts_longer_than_a_set() {
        let again: Table = toml::from_str(&text()).expect("it is TOML");
        assert!(again["segment"][2]["until"].as_float() > Some(END.as_seconds() + 60.0));
        let scenario = sim_world::Scenario::parse(&text(), Path::new("faults.toml")).expect("it can be sailed");
        let world = sim_world::World::new(&scenario, sim_world::Preset::Realistic, 1).expect("it can be sailed");
        assert!(world.gnss().next().is_some());
    }
}
