use std::{collections::BTreeSet, fs, path::PathBuf};

/// Which stages each crate may depend on (ARCHITECTURE.md, "The dependency rule").
const ALLOWED: [(&str, &[&str]); 10] = [
    ("world", &[]),
    ("traffic", &["world"]),
    ("sensors", &["world", "traffic"]),
    ("perception", &["world"]),
    ("sharing", &["world"]),
    ("planner", &["world"]),
    ("control", &["world"]),
    ("viewer", &["world"]),
    (
        "drive",
        &[
            "world",
            "traffic",
            "sensors",
            "perception",
            "sharing",
            "planner",
            "control",
        ],
    ),
    (
        "app",
        &["world", "sensors", "perception", "drive", "viewer"],
    ),
];

/// Libraries that only the named crate may name.
const SPECIAL: [(&str, &[&str]); 8] = [
    ("ort", &["perception"]),
    ("ndarray", &["perception"]),
    ("parry3d", &["sensors"]),
    ("clarabel", &["control"]),
    ("rerun", &["viewer"]),
    ("plotters", &["viewer"]),
    ("clap", &["app"]),
    ("anyhow", &["app"]),
];

fn manifest(folder: &str) -> toml::Table {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("..")
        .join(folder)
        .join("Cargo.toml");
    fs::read_to_string(&path)
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()))
        .parse()
        .expect("a manifest")
}

/// The names under [dependencies], [dev-dependencies] and [build-dependencies].
fn dependencies(folder: &str) -> BTreeSet<String> {
    let manifest = manifest(folder);
    ["dependencies", "dev-dependencies", "build-dependencies"]
        .iter()
        .filter_map(|kind| manifest.get(*kind)?.as_table())
        .flat_map(|table| table.keys().cloned())
        .collect()
}

#[test]
fn every_member_is_covered_by_the_rule() {
    let root = manifest(".");
    let members: BTreeSet<&str> = root["workspace"]["members"]
        .as_array()
        .expect("members")
        .iter()
        .filter_map(|member| member.as_str())
        .collect();
    assert_eq!(members, ALLOWED.iter().map(|(name, _)| *name).collect());
}

#[test]
fn stages_depend_on_the_vocabulary_and_on_no_other_stage() {
    for (folder, allowed) in ALLOWED {
        for dependency in dependencies(folder) {
            if let Some(stage) = dependency.strip_prefix("covista-") {
                assert!(
                    allowed.contains(&stage),
                    "{folder} must not depend on {dependency}"
                );
            }
        }
    }
}

#[test]
fn special_libraries_stay_where_they_belong() {
    for (folder, _) in ALLOWED {
        let named = dependencies(folder);
        for (library, owners) in SPECIAL {
            assert!(
                !named.contains(library) || owners.contains(&folder),
                "{folder} must not name {library}"
            );
        }
    }
}
