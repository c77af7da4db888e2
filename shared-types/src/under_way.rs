//! Which settings may change while the vehicle is under way.
//!
//! What belongs to an aiding sensor may: it is what another instrument brings with it, and nothing of it lives on in a state. Frame,
//! IMU, keyframes, window and estimator are what the state itself and the queues of every process are made of: whoever changes
//! those begins anew.

use toml::{Table, Value};

use crate::config::{Config, ConfigError};

/// Sections that may change: those of the aiding sensors and of the buoys.
const CHANGEABLE: [&str; 6] = ["lbl", "gnss", "dvl", "mcp", "ps", "buoys"];

impl Config {
    /// Whether a run under this configuration may go on under `next`.
    ///
    /// # Errors
    /// [`ConfigError::UnderWay`], naming the first key that may not change.
    pub fn may_become(&self, next: &Config) -> Result<(), ConfigError> {
        let (before, after) = (self.effective(), next.effective());
        let names = before.keys().chain(after.keys().filter(|name| !before.contains_key(*name)));
        for name in names.filter(|name| !CHANGEABLE.contains(&name.as_str())) {
            if let Some(key) = difference(name, before.get(name), after.get(name)) {
                return Err(ConfigError::UnderWay { key });
            }
        }
        Ok(())
    }
}

/// The first key of a section, or the name itself where it is none, whose values are not the same.
fn difference(name: &str, before: Option<&Value>, after: Option<&Value>) -> Option<String> {
    let nothing = Table::new();
    let of = |value: Option<&Value>| value.and_then(Value::as_table).cloned();
    match (of(before), of(after)) {
        (None, None) => (before != after).then(|| name.to_owned()),
        (before, after) => {
            let (before, after) = (before.unwrap_or(nothing.clone()), after.unwrap_or(nothing));
            let mut keys = before.keys().chain(after.keys());
            keys.find(|key| before.get(*key) != after.get(*key)).map(|key| format!("{name}.{key}"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ConfigText;

    fn with(sets: &[&str]) -> Config {
        let file = ConfigText::new("in_force.toml", "[dvl]\nsigma = 0.02\n[frame]\norigin = [36.0, 127.0, 0.0]\n");
        Config::load(&[file], &sets.iter().map(|set| (*set).to_owned()).collect::<Vec<_>>()).expect("valid")
    }

    #[test]
    fn a_sensor_may_be_another_and_the_rest_is_refused_by_its_key() {
        let same = with(&[]);
        for fine in [
            "dvl.sigma=0.05",
            "dvl.mounting_rpy=[0, 0, 90]",
            "lbl.enabled=false",
            "mcp.declination=3",
            "buoys.max_age=5",
        ] {
            assert_eq!(same.may_become(&with(&[fine])), Ok(()), "{fine}");
        }
        let cases = [
            ("estimator=ekf", "estimator"),
            ("frame.origin=[36.0, 127.1, 0.0]", "frame.origin"),
            ("frame.surface_height=3", "frame.surface_height"),
            ("initial.position=[0, 0, 0]", "initial.position"),
            ("imu.gyro_noise_density=1e-3", "imu.gyro_noise_density"),
            ("fgo.window=30", "fgo.window"),
            ("keyframes.max_age=2", "keyframes.max_age"),
        ];
        for (set, key) in cases {
            let error = same.may_become(&with(&["dvl.sigma=0.05", set])).expect_err(set);
            assert_eq!(error, ConfigError::UnderWay { key: key.to_owned() });
            assert!(error.to_string().starts_with(&format!("`{key}` cannot change under way")), "{error}");
        }
        // What the file no longer names has changed, too.
        let without = Config::load(&[], &[]).expect("valid");
        assert!(same.may_become(&without).is_err() && without.may_become(&same).is_err());
    }

    /// Splitmix64: every run spoils in the same way.
    fn draw(state: &mut u64) -> u64 {
        *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// A file of the sections of some sensors, with one thing or several not as they were.
    fn mutated(lines: &[&str], state: &mut u64) -> String {
        const VALUES: [&str; 16] = [
            "0",
            "-1",
            "1e308",
            "nan",
            "inf",
            "-inf",
            "\"huber\"",
            "true",
            "[1, 2]",
            "[0.1, 0.2, 0.3]",
            "1e-300",
            "0.5",
            "\"\"",
            "{ }",
            "99999999999999999999",
            "1970-01-01",
        ];
        let mut below = |limit: usize| (draw(state) % limit as u64) as usize;
        let mut file: Vec<String> = lines.iter().map(|line| (*line).to_owned()).collect();
        for _ in 0..=below(3) {
            let at = below(file.len());
            match below(5) {
                0 => {
                    let key = file[at].split_once('=').map(|(key, _)| key.to_owned());
                    if let Some(key) = key {
                        file[at] = format!("{key}= {}", VALUES[below(VALUES.len())]);
                    }
                }
                1 => {
                    file.remove(at);
                }
                2 => {
                    let other = below(file.len());
                    file.swap(at, other);
                }
                3 => {
                    let line = file[at].clone();
                    file.insert(at, line);
                }
                _ => {
                    let mut bytes = file[at].clone().into_bytes();
                    if !bytes.is_empty() {
                        let place = below(bytes.len());
                        bytes[place] = b' ' + below(95) as u8;
                    }
                    file[at] = String::from_utf8(bytes).expect("ASCII");
                }
            }
            if file.is_empty() {
                break;
            }
        }
        file.join("\n")
    }

    /// F34: one hundred thousand of them, each refused with one line or sound. A value that changed something else than a sensor is refused,
    /// however sound it is.
    #[test]
    fn of_a_hundred_thousand_mutated_configurations_each_is_refused_or_sound() {
        let in_force = with(&[]);
        let text = in_force.to_toml();
        let sections: Vec<Vec<&str>> = text.split("\n\n").map(|section| section.lines().collect()).collect();
        let (mut state, mut taken, mut refused) = (34, 0, 0);
        for number in 0..100_000 {
            // One section at a time: the others are as they are, and reading them again would take a minute.
            let section = &sections[(draw(&mut state) % sections.len() as u64) as usize];
            let file = ConfigText::new("new.toml", mutated(section, &mut state));
            match Config::load(std::slice::from_ref(&file), &[]) {
                Err(error) => {
                    refused += 1;
                    let line = error.to_string();
                    assert!(!line.is_empty() && !line.contains('\n'), "number {number}: {line:?}");
                }
                Ok(next) => {
                    taken += 1;
                    // What is taken is written down for those who come after, and means the same to them.
                    if taken % 50 == 0 {
                        let again = Config::load(&[ConfigText::new("again.toml", next.to_toml())], &[]);
                        assert_eq!(again.as_ref(), Ok(&next), "number {number}: {}", file.text);
                    }
                    let is_fixed =
                        next.vehicle.frame == in_force.vehicle.frame && next.vehicle.imu == in_force.vehicle.imu;
                    assert!(is_fixed || in_force.may_become(&next).is_err(), "number {number}: {}", file.text);
                }
            }
        }
        assert!(taken > 10_000 && refused > 10_000, "{taken} taken, {refused} refused");
    }
}
