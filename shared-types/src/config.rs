//! The effective configuration: vehicle facts and navigator choices, from files and `--set section.key=value`.
//!
//! Both halves share section names (`[lbl]` holds the vehicle's `sigma` and the navigator's `kernel`) but no key, so one
//! `section.key` names one fact and one file may hold both. Unknown keys are refused with file, line and a suggestion.

use std::path::{Path, PathBuf};

use toml::{Table, Value};

use crate::navigator::{self, Navigator};
use crate::vehicle::{self, Vehicle};

/// A TOML text and where it came from.
#[derive(Clone, Debug)]
pub struct ConfigText {
    /// For messages.
    pub file: PathBuf,
    /// Its content.
    pub text: String,
}

/// The effective configuration.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Config {
    /// Facts of the vehicle.
    pub vehicle: Vehicle,
    /// Choices of the navigator.
    pub navigator: Navigator,
    table: Table,
}

/// A configuration that cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ConfigError {
    /// Not TOML, an unknown key, or a value of the wrong type.
    #[error("{}:{line}:{column}: {message}", file.display())]
    Parse {
        /// Which file.
        file: PathBuf,
        /// From 1.
        line: usize,
        /// From 1.
        column: usize,
        /// What is wrong.
        message: String,
    },
    /// A value outside its domain, found in a file.
    #[error("{}:{line}: `{key}` is {found}; it must be {expected}", file.display())]
    Value {
        /// Which file.
        file: PathBuf,
        /// From 1.
        line: usize,
        /// `section.key`.
        key: &'static str,
        /// What stands there.
        found: String,
        /// What may stand there.
        expected: &'static str,
    },
    /// A value outside its domain, given by `--set`.
    #[error("--set {key}: it is {found}; it must be {expected}")]
    SetValue {
        /// `section.key`.
        key: &'static str,
        /// What was given.
        found: String,
        /// What may be given.
        expected: &'static str,
    },
    /// `--set` that is no `section.key=value`, or names no key.
    #[error("--set {text}: {message}")]
    Set {
        /// As given.
        text: String,
        /// What is wrong.
        message: String,
    },
    /// A value that is sound, and cannot take the place of the one in force.
    #[error(
        "`{key}` cannot change under way: only [lbl], [gnss], [dvl], [mcp], [ps] and [buoys] can (end the run and begin anew)"
    )]
    UnderWay {
        /// `section.key`.
        key: String,
    },
}

/// A value outside its domain, before it is known where it was written.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Problem {
    key: &'static str,
    found: String,
    expected: &'static str,
}

impl Problem {
    pub(crate) fn new(key: &'static str, found: String, expected: &'static str) -> Problem {
        Problem { key, found, expected }
    }
}

pub(crate) fn positive(key: &'static str, value: f64) -> Result<f64, Problem> {
    if value.is_finite() && value > 0.0 {
        Ok(value)
    } else {
        Err(Problem::new(key, value.to_string(), "a positive number"))
    }
}

pub(crate) fn non_negative(key: &'static str, value: f64) -> Result<f64, Problem> {
    if value.is_finite() && value >= 0.0 {
        Ok(value)
    } else {
        Err(Problem::new(key, value.to_string(), "zero or a positive number"))
    }
}

impl Config {
    /// Defaults, then `files` in order, then `sets` (`section.key=value`), later ones winning.
    ///
    /// # Errors
    /// [`ConfigError`], naming the file and line or the `--set` at fault.
    pub fn load(files: &[ConfigText], sets: &[String]) -> Result<Config, ConfigError> {
        let schema = Schema::new();
        let mut table = Table::new();
        for file in files {
            overlay(&mut table, schema.parse(file)?);
        }
        for set in sets {
            let (section, key, value) = schema.parse_set(set)?;
            insert(&mut table, section, key, value);
        }
        let (vehicle_table, navigator_table) = schema.split(&table);
        // Types were checked per file; what can still fail here is a value given by `--set`.
        let by_set =
            |error: toml::de::Error| ConfigError::Set { text: sets.join(" "), message: error.message().to_owned() };
        let mut vehicle: vehicle::Sections = vehicle_table.try_into().map_err(by_set)?;
        vehicle.settle();
        let is_anchor_given = Schema::holds(&navigator_table, Some("keyframes"), "anchor");
        let mut navigator: navigator::Sections = navigator_table.try_into().map_err(by_set)?;
        let blame = |problem: Problem| blame(problem, files, sets);
        let checked = Vehicle::try_from(&vehicle).map_err(blame)?;
        navigator.settle(&checked, is_anchor_given);
        Ok(Config {
            vehicle: checked,
            navigator: Navigator::try_from(&navigator).map_err(blame)?,
            table: effective(&vehicle, &navigator),
        })
    }

    /// The whole effective configuration as TOML; [`Config::load`] reads it back to the same.
    pub fn to_toml(&self) -> String {
        self.effective().to_string()
    }

    /// Every key with its value.
    pub(crate) fn effective(&self) -> Table {
        if self.table.is_empty() {
            effective(&vehicle::Sections::default(), &navigator::Sections::default())
        } else {
            self.table.clone()
        }
    }
}

fn effective(vehicle: &vehicle::Sections, navigator: &navigator::Sections) -> Table {
    let mut table = Table::try_from(vehicle).expect("the vehicle's sections are TOML");
    overlay(&mut table, Table::try_from(navigator).expect("the navigator's sections are TOML"));
    table
}

fn overlay(base: &mut Table, over: Table) {
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(Value::Table(inner)), Value::Table(new)) => overlay(inner, new),
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}

fn insert(table: &mut Table, section: Option<String>, key: String, value: Value) {
    match section {
        None => {
            table.insert(key, value);
        }
        Some(section) => {
            if let Value::Table(inner) = table.entry(section).or_insert_with(|| Value::Table(Table::new())) {
                inner.insert(key, value);
            }
        }
    }
}

/// Which keys exist, taken from the serialised defaults, so that there is no second list to forget.
struct Schema {
    vehicle: Table,
    navigator: Table,
}

impl Schema {
    fn new() -> Schema {
        let mut vehicle = Table::try_from(vehicle::Sections::default()).expect("the defaults are TOML");
        for (section, key) in vehicle::OPTIONAL_KEYS {
            insert(&mut vehicle, Some(section.to_owned()), key.to_owned(), Value::Boolean(true));
        }
        let navigator = Table::try_from(navigator::Sections::default()).expect("the defaults are TOML");
        Schema { vehicle, navigator }
    }

    fn holds(table: &Table, section: Option<&str>, key: &str) -> bool {
        match section {
            None => table.get(key).is_some_and(|value| !value.is_table()),
            Some(section) => table.get(section).and_then(Value::as_table).is_some_and(|inner| inner.contains_key(key)),
        }
    }

    fn known(&self, section: Option<&str>, key: &str) -> bool {
        Schema::holds(&self.vehicle, section, key) || Schema::holds(&self.navigator, section, key)
    }

    /// Every `section.key`, for suggestions.
    fn keys(&self) -> Vec<String> {
        let mut keys = Vec::new();
        for table in [&self.vehicle, &self.navigator] {
            for (name, value) in table {
                match value.as_table() {
                    Some(inner) => keys.extend(inner.keys().map(|key| format!("{name}.{key}"))),
                    None => keys.push(name.clone()),
                }
            }
        }
        keys
    }

    fn unknown(&self, name: &str) -> String {
        let near = self.keys().into_iter().map(|key| (distance(name, &key), key)).min();
        match near {
            Some((steps, key)) if steps <= 3 => format!("unknown key `{name}` (did you mean `{key}`?)"),
            _ => format!("unknown key `{name}` (`--print-config` lists every key)"),
        }
    }

    /// Parses one file and checks its keys and types against the sections, with positions.
    fn parse(&self, file: &ConfigText) -> Result<Table, ConfigError> {
        let at = |offset: usize, message: String| {
            let before = &file.text[..offset.min(file.text.len())];
            ConfigError::Parse {
                file: file.file.clone(),
                line: before.matches('\n').count() + 1,
                column: before.rsplit('\n').next().map_or(0, |line| line.chars().count()) + 1,
                message,
            }
        };
        let offset_of = |error: &toml::de::Error| error.span().map_or(0, |span| span.start);
        let one_line = |message: &str| message.trim().replace('\n', ", ");
        let table: Table = toml::from_str(&file.text).map_err(|e| at(offset_of(&e), one_line(e.message())))?;
        for (name, value) in &table {
            match value.as_table() {
                Some(inner) => {
                    if let Some(key) = inner.keys().find(|key| !self.known(Some(name), key)) {
                        let offset = find_key(&file.text, Some(name), key);
                        return Err(at(offset, self.unknown(&format!("{name}.{key}"))));
                    }
                }
                None if !self.known(None, name) => {
                    return Err(at(find_key(&file.text, None, name), self.unknown(name)));
                }
                None => {}
            }
        }
        // Types: each half from its own part of the table; the message names the key, the position is looked up.
        let (vehicle_table, navigator_table) = self.split(&table);
        let typed = |error: toml::de::Error| {
            let message = one_line(error.message());
            let key = error.to_string().split('`').nth(1).unwrap_or_default().to_owned();
            let (section, key) = key.split_once('.').map_or((None, key.as_str()), |(s, k)| (Some(s), k));
            at(
                find_key(&file.text, section, key),
                match section {
                    Some(section) => format!("`{section}.{key}`: {message}"),
                    None => message,
                },
            )
        };
        vehicle_table.try_into::<vehicle::Sections>().map_err(typed)?;
        navigator_table.try_into::<navigator::Sections>().map_err(typed)?;
        Ok(table)
    }

    fn parse_set(&self, text: &str) -> Result<(Option<String>, String, Value), ConfigError> {
        let fail = |message: String| ConfigError::Set { text: text.to_owned(), message };
        let (name, value) =
            text.split_once('=').ok_or_else(|| fail("expected section.key=value, such as fgo.window=30".to_owned()))?;
        let (section, key) = name.trim().rsplit_once('.').map_or((None, name.trim()), |(s, k)| (Some(s), k));
        if !self.known(section, key) {
            return Err(fail(self.unknown(name.trim())));
        }
        // A bare word (`huber`) is meant as a string; a whole number is welcome where a decimal is expected.
        let parsed: Value = toml::from_str::<Table>(&format!("v = {}", value.trim()))
            .or_else(|_| toml::from_str::<Table>(&format!("v = {:?}", value.trim())))
            .ok()
            .and_then(|mut table| table.remove("v"))
            .ok_or_else(|| fail("the value is not TOML".to_owned()))?;
        Ok((section.map(str::to_owned), key.to_owned(), parsed))
    }

    /// The vehicle's part and the navigator's part.
    fn split(&self, table: &Table) -> (Table, Table) {
        let (mut vehicle, mut navigator) = (Table::new(), Table::new());
        for (name, value) in table {
            match value.as_table() {
                Some(inner) => {
                    for (key, value) in inner {
                        let half =
                            if Schema::holds(&self.vehicle, Some(name), key) { &mut vehicle } else { &mut navigator };
                        insert(half, Some(name.clone()), key.clone(), value.clone());
                    }
                }
                None => {
                    navigator.insert(name.clone(), value.clone());
                }
            }
        }
        (vehicle, navigator)
    }
}

/// Byte offset of a key in a text, good enough to name its line; 0 when it is not written plainly.
fn find_key(text: &str, section: Option<&str>, key: &str) -> usize {
    let mut current: Option<String> = None;
    let mut offset = 0;
    for line in text.split_inclusive('\n') {
        let plain = line.trim();
        if let Some(header) = plain.strip_prefix('[') {
            current = header.split(']').next().map(|name| name.trim().to_owned());
        } else if let Some((name, _)) = plain.split_once('=') {
            let name = name.trim();
            let dotted = section.map(|section| format!("{section}.{key}"));
            if (current.as_deref() == section && name == key) || (current.is_none() && dotted.as_deref() == Some(name))
            {
                return offset + (line.len() - line.trim_start().len());
            }
        }
        offset += line.len();
    }
    0
}

/// Says where a value outside its domain was written: the last file that holds it, unless a `--set` came after.
fn blame(problem: Problem, files: &[ConfigText], sets: &[String]) -> ConfigError {
    let Problem { key, found, expected } = problem;
    let in_sets = sets.iter().any(|set| set.split('=').next().map(str::trim) == Some(key));
    let (section, name) = key.split_once('.').map_or((None, key), |(section, name)| (Some(section), name));
    let written = files
        .iter()
        .rev()
        .find(|file| toml::from_str::<Table>(&file.text).is_ok_and(|table| Schema::holds(&table, section, name)));
    match written {
        Some(file) if !in_sets => {
            let line = file.text[..find_key(&file.text, section, name)].matches('\n').count() + 1;
            ConfigError::Value { file: file.file.clone(), line, key, found, expected }
        }
        _ => ConfigError::SetValue { key, found, expected },
    }
}

/// Edit distance, for "did you mean".
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, ca) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, cb) in b.iter().enumerate() {
            let cost = diagonal + usize::from(ca != *cb);
            diagonal = row[j + 1];
            row[j + 1] = cost.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

impl ConfigText {
    /// A text with a name for messages.
    pub fn new(file: impl AsRef<Path>, text: impl Into<String>) -> ConfigText {
        ConfigText { file: file.as_ref().to_owned(), text: text.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AnchorMethod, Kernel, Sensor};

    fn load(text: &str, sets: &[&str]) -> Result<Config, ConfigError> {
        let sets: Vec<String> = sets.iter().map(|s| (*s).to_owned()).collect();
        Config::load(&[ConfigText::new("sensors.toml", text)], &sets)
    }

    #[test]
    fn an_empty_file_gives_the_documented_defaults() {
        let config = load("", &[]).expect("valid");
        assert_eq!(config.vehicle, Vehicle::default());
        assert_eq!(config.navigator.fgo.window, 20);
    }

    #[test]
    fn degrees_become_radians_once() {
        let config = load("[mcp]\nsigma = 180.0\n[dvl]\nmounting_rpy = [0.0, 0.0, 90.0]\n", &[]).expect("valid");
        assert!((config.vehicle.mcp.sigma - core::f64::consts::PI).abs() < 1e-15);
        assert!((config.vehicle.dvl.mounting_rpy[2] - core::f64::consts::FRAC_PI_2).abs() < 1e-15);
    }

    #[test]
    fn set_reaches_both_halves_and_bare_words() {
        let sets = [
            "lbl.sigma=0.5",
            "dvl.enabled=false",
            "keyframes.anchor=pf",
            "gnss.kernel=huber",
            "fgo.window=30",
            "lbl.common_offset_sigma=inf",
        ];
        let config = load("[lbl]\nsigma = 0.1\n", &sets).expect("valid");
        assert_eq!(config.vehicle.lbl.sigma, 0.5);
        assert!(!config.navigator.is_enabled(Sensor::Dvl));
        assert_eq!(config.navigator.keyframes.anchor, AnchorMethod::Pf);
        assert_eq!(config.navigator.sensor(Sensor::Gnss).map(|s| s.kernel), Some(Kernel::Huber(2.385)));
        assert_eq!(config.navigator.fgo.window, 30);
        assert_eq!(config.navigator.lbl_common_offset_sigma, f64::INFINITY);
    }

    #[test]
    fn the_printed_configuration_reads_back_to_the_same() {
        let config = load("[frame]\norigin = [1.0, 2.0, 3.0]\n[ps]\nsigma = 0.5\n", &["fgo.fej=false"]).expect("valid");
        assert_eq!(load(&config.to_toml(), &[]).expect("valid"), config);
        let default = Config::default();
        assert_eq!(load(&default.to_toml(), &[]).expect("valid").navigator, default.navigator);
    }

    #[test]
    fn an_imu_that_would_drown_a_doppler_velocity_on_the_way_makes_one_factor_of_both() {
        let noisy = "[imu]\naccel_noise_density = 0.3\n[dvl]\nsigma = 0.03\n";
        let config = load(noisy, &[]).expect("valid");
        assert_eq!(config.navigator.keyframes.anchor, AnchorMethod::Joint);
        assert!(config.to_toml().contains("anchor = \"joint\""));
        assert_eq!(load(&config.to_toml(), &[]).expect("its own words"), config);
        let anchor = |sets: &[&str]| load(noisy, sets).expect("valid").navigator.keyframes.anchor;
        assert_eq!(anchor(&["keyframes.anchor=fbpf"]), AnchorMethod::Fbpf, "as it was told");
        assert_eq!(anchor(&["imu.accel_noise_density=0.03"]), AnchorMethod::Fbpf);
        assert_eq!(anchor(&["dvl.enabled=false"]), AnchorMethod::Fbpf);
        assert_eq!(anchor(&["estimator=ekf"]), AnchorMethod::AtOnce);
    }

    #[test]
    fn an_accelerometer_that_is_too_good_to_be_true_is_shown_as_what_it_counts_as() {
        let config = load("[imu]\naccel_noise_density = 9.8e-7\n", &[]).expect("valid");
        assert_eq!(config.vehicle.imu.accel_noise_density, 1e-5);
        let shown = ConfigText::new("shown.toml", config.to_toml());
        assert_eq!(Config::load(&[shown], &[]).expect("valid").vehicle.imu.accel_noise_density, 1e-5);
        assert!(config.to_toml().contains("accel_noise_density = 0.00001"), "{}", config.to_toml());
        for none in ["0.0", "-1e-3", "nan"] {
            assert!(load("", &[&format!("imu.accel_noise_density={none}")]).is_err(), "{none}");
        }
    }

    #[test]
    fn a_filter_ties_no_reading_and_says_so() {
        let config = load("", &["estimator=ekf"]).expect("valid");
        assert_eq!(config.navigator.keyframes.anchor, AnchorMethod::AtOnce);
        assert!(config.to_toml().contains("anchor = \"at_once\""));
        assert_eq!(load(&config.to_toml(), &[]).expect("its own words"), config);
        let error = load("", &["estimator=fkf", "keyframes.anchor=pf"]).expect_err("a filter has no keyframes");
        assert!(error.to_string().contains("keyframes.anchor: it is pf; it must be at_once"), "{error}");
        let error = load("[keyframes]\nanchor = \"at_once\"\n", &[]).expect_err("a smoother has");
        assert!(error.to_string().contains("fbpf, joint, fpf or pf"), "{error}");
    }

    #[test]
    fn a_misspelt_key_is_named_with_line_and_mend() {
        let error = load("[frame]\n[lbl]\nsigmma = 0.3\n", &[]).expect_err("unknown key");
        assert_eq!(error.to_string(), "sensors.toml:3:1: unknown key `lbl.sigmma` (did you mean `lbl.sigma`?)");
    }

    #[test]
    fn a_negative_sigma_is_named_with_its_line() {
        let error = load("[lbl]\nsigma = -0.3\n", &[]).expect_err("negative");
        assert_eq!(error.to_string(), "sensors.toml:2: `lbl.sigma` is -0.3; it must be a positive number");
        let error = load("", &["ps.sigma=0.0"]).expect_err("zero");
        assert_eq!(error.to_string(), "--set ps.sigma: it is 0; it must be a positive number");
    }

    #[test]
    fn a_quaternion_that_is_no_rotation_is_refused() {
        let error = load("[initial]\nquaternion = [1.0, 1.0, 0.0, 0.0]\n", &[]).expect_err("not unit");
        assert!(error.to_string().contains("sensors.toml:2: `initial.quaternion`"), "{error}");
    }

    #[test]
    fn a_wrong_type_is_named_with_its_line() {
        let error = load("[lbl]\nsigma = \"a lot\"\n", &[]).expect_err("text");
        assert!(error.to_string().starts_with("sensors.toml:2:"), "{error}");
    }

    #[test]
    fn a_window_of_one_is_refused() {
        let error = load("", &["fgo.window=1"]).expect_err("too small");
        assert!(error.to_string().contains("2 to 500"), "{error}");
    }
}
