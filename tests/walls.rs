//! Who may lean on whom: the declared dependencies of every crate against the table of the house.
//!
//! A crate's direct house dependencies stand in its row or in the closure of its row; "never" is transitive. Outside
//! crates are free unless a row forbids them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Crate, what it may use, what it must never reach.
type Row = (&'static str, &'static [&'static str], &'static [&'static str]);

const ESTIMATORS: [&str; 3] = ["nav-fgo", "nav-kalman", "nav-pipeline"];

const TABLE: &[Row] = &[
    ("shared-types", &[], &["nalgebra"]),
    ("nav-geometry", &[], &["shared-types"]),
    ("nav-models", &["nav-geometry", "shared-types"], &["faer", "nav-fgo"]),
    ("nav-preprocessing", &["nav-geometry", "shared-types"], &["nav-models"]),
    ("nav-fgo", &["nav-models"], &["nav-preprocessing", "nav-kalman"]),
    ("nav-kalman", &["nav-models"], &["nav-preprocessing", "nav-fgo", "faer"]),
    (
        "nav-pipeline",
        &["nav-preprocessing", "nav-fgo", "nav-kalman", "nav-models"],
        &["ilns-recording", "ilns-runtime"],
    ),
    ("nav-evaluation", &["nav-geometry", "shared-types"], &["nav-models", "nav-fgo", "nav-pipeline"]),
    ("ilns-bus", &["shared-types"], &["ilns-runtime", "nav-geometry"]),
    ("ilns-runtime", &["shared-types"], &["nav-geometry", "nav-models", "ilns-bus"]),
    ("ilns-recording", &["shared-types", "nav-geometry"], &["ilns-runtime", "nav-fgo", "nav-pipeline"]),
    (
        "ilns-preprocessor",
        &["ilns-runtime", "ilns-bus", "nav-preprocessing", "ilns-recording"],
        &["nav-models", "nav-fgo"],
    ),
    ("ilns-solver", &["ilns-runtime", "ilns-bus", "nav-pipeline", "ilns-recording"], &["ilns-propagator"]),
    ("ilns-propagator", &["ilns-runtime", "ilns-bus", "nav-models", "nav-preprocessing"], &["nav-fgo", "ilns-solver"]),
    (
        "ilns-recorder",
        &["ilns-runtime", "ilns-bus", "ilns-recording", "nav-geometry", "nav-evaluation"],
        &["nav-fgo", "nav-pipeline"],
    ),
    (
        "ilns-monitor",
        &["ilns-runtime", "ilns-bus", "ilns-recording", "nav-geometry", "nav-evaluation"],
        &["nav-fgo", "nav-pipeline"],
    ),
    (
        "ilns-replay",
        &["nav-pipeline", "ilns-recording", "nav-evaluation", "sim-world", "ilns-runtime"],
        &["ilns-bus", "iceoryx2"],
    ),
    (
        "experiments",
        &[
            "nav-pipeline",
            "nav-models",
            "nav-preprocessing",
            "ilns-recording",
            "nav-evaluation",
            "sim-world",
            "ilns-runtime",
            "ilns-replay",
        ],
        &["ilns-bus", "iceoryx2"],
    ),
    ("sim-faults", &["nav-geometry", "shared-types"], &["nav-models"]),
    ("sim-world", &["nav-geometry", "shared-types", "sim-faults"], &["nav-models"]),
    (
        "sim-emulators",
        &["sim-world", "ilns-recording", "ilns-runtime", "ilns-bus"],
        &["nav-preprocessing", "nav-models"],
    ),
    (
        "ilns",
        &[
            "ilns-runtime",
            "ilns-bus",
            "ilns-preprocessor",
            "ilns-solver",
            "ilns-propagator",
            "ilns-recorder",
            "ilns-recording",
            "ilns-monitor",
            "ilns-replay",
            "sim-emulators",
        ],
        &[],
    ),
];

/// Direct, normal dependencies of every workspace crate, as its manifest declares them.
fn declared() -> BTreeMap<String, BTreeSet<String>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let read = |path: &Path| -> toml::Table {
        let text = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        toml::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
    };
    let workspace = read(&root.join("Cargo.toml"));
    let members = workspace["workspace"]["members"].as_array().expect("members are a list").clone();
    let mut crates = BTreeMap::new();
    let mut add = |manifest: &toml::Table| {
        let name = manifest["package"]["name"].as_str().expect("a package has a name").to_owned();
        let dependencies = manifest.get("dependencies").and_then(toml::Value::as_table);
        // An optional dependency is there for whoever asks for its feature: `shared-types` knows iceoryx2 for the bus alone.
        let is_optional = |value: &toml::Value| value.get("optional").and_then(toml::Value::as_bool) == Some(true);
        let normal = dependencies.into_iter().flatten().filter(|(_, value)| !is_optional(value));
        crates.insert(name, normal.map(|(key, _)| key.clone()).collect());
    };
    add(&workspace);
    for member in members {
        add(&read(&root.join(member.as_str().expect("a member is a path")).join("Cargo.toml")));
    }
    crates
}

/// Everything reachable from `start` over `edges`, itself excluded.
fn closure<'a>(start: &str, edges: &'a BTreeMap<String, BTreeSet<String>>) -> BTreeSet<&'a str> {
    let mut reached = BTreeSet::new();
    let mut open: Vec<&str> = vec![start];
    while let Some(name) = open.pop() {
        for next in edges.get(name).into_iter().flatten() {
            if reached.insert(next.as_str()) {
                open.push(next);
            }
        }
    }
    reached
}

#[test]
fn every_crate_has_a_row_and_every_row_a_crate() {
    let crates = declared();
    let rows: BTreeSet<&str> = TABLE.iter().map(|row| row.0).collect();
    let names: BTreeSet<&str> = crates.keys().map(String::as_str).collect();
    assert_eq!(names, rows);
}

#[test]
fn no_crate_leans_on_what_its_row_does_not_name() {
    let crates = declared();
    let table: BTreeMap<String, BTreeSet<String>> = TABLE
        .iter()
        .map(|(name, may, _)| ((*name).to_owned(), may.iter().map(|m| (*m).to_owned()).collect()))
        .collect();
    for (name, dependencies) in &crates {
        let allowed = closure(name, &table);
        for dependency in dependencies.iter().filter(|dependency| crates.contains_key(*dependency)) {
            assert!(allowed.contains(dependency.as_str()), "{name} uses {dependency}, which its row does not allow");
        }
    }
}

#[test]
fn no_crate_reaches_what_it_must_never_use() {
    let crates = declared();
    for (name, _, never) in TABLE {
        let reached = closure(name, &crates);
        for forbidden in *never {
            assert!(!reached.contains(forbidden), "{name} reaches {forbidden}");
        }
    }
    // Shared memory and what sleeps on it is the bus's affair; the payloads say how they lie in it.
    for (name, dependencies) in &crates {
        let is_own = name == "ilns-bus" || name == "shared-types";
        let shares = dependencies.iter().find(|other| other.starts_with("iceoryx2") && !is_own);
        assert_eq!(shares, None, "{name} goes past ilns-bus");
    }
    for estimator in ESTIMATORS {
        for outside in ["tracing", "iceoryx2", "rand", "tracing-subscriber"] {
            assert!(!closure(estimator, &crates).contains(outside), "{estimator} reaches {outside}");
        }
    }
}

#[test]
fn the_vehicle_and_scenario_files_of_the_house_parse() {
    let scenarios = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/scenarios");
    let mut seen = 0;
    for entry in std::fs::read_dir(&scenarios).expect("deploy/scenarios exists") {
        let path = entry.expect("readable folder").path();
        let text = std::fs::read_to_string(&path).expect("readable file");
        if let Err(error) = sim_world::Scenario::parse(&text, &path) {
            panic!("{}: {error}", path.display());
        }
        seen += 1;
    }
    assert!(seen >= 3, "mission, stable and outage");
}
