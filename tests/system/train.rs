use std::{fs, path::Path, process::Command};

use crate::binary::{assert_one_line_error, covista};

const TINY: &str = r#"
environments = 2

[environment]
steps = 8
neighbours = 3

[environment.ring]
vehicles = 6
cavs = 2

[training]
sharing = "shared"

[training.hyperparameters]
hidden = 16
minibatch = 8
warm_up = 8
"#;

fn train(config: &str, folder: &Path, more: &[&str]) -> Command {
    let file = folder.join("config.toml");
    fs::write(&file, config).expect("a configuration");
    let mut command = covista();
    command
        .args(["train", "--config"])
        .arg(&file)
        .arg("--out")
        .arg(folder.join("run"))
        .args(more);
    command
}

fn trained(config: &str, folder: &Path, more: &[&str]) -> String {
    let output = train(config, folder, more).output().expect("covista runs");
    assert!(output.status.success(), "{output:?}");
    String::from_utf8(output.stdout).expect("text")
}

#[test]
fn a_training_writes_its_curve_and_goes_on_where_it_ended() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = folder.path().join("run");
    let said = trained(TINY, folder.path(), &["--decisions", "18"]);
    assert!(
        said.contains("trained 2 rounds") && said.contains("0 unsafe actions"),
        "{said}"
    );
    let curve = fs::read_to_string(run.join("curve.csv")).expect("a curve");
    let updates = |line: &str| {
        let fields: Vec<f64> = line
            .split(',')
            .map(|field| field.parse().expect("a number"))
            .collect();
        fields[10]
    };
    let rows: Vec<&str> = curve.lines().skip(1).collect();
    assert_eq!(rows.len(), 2);
    assert!(updates(rows[1]) > 0.0, "{curve}");
    for file in ["policy.safetensors", "learning.rrd", "settings.json"] {
        assert!(run.join(file).is_file(), "{file}");
    }

    trained(TINY, folder.path(), &["--resume", "--decisions", "19"]);
    let longer = fs::read_to_string(run.join("curve.csv")).expect("a curve");
    assert!(
        longer.starts_with(&curve) && longer.lines().count() == 4,
        "{longer}"
    );
}

#[test]
fn a_training_with_the_errors_of_perception_is_another_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let run = folder.path().join("run");
    let statistical = TINY.replace("steps = 8", "steps = 8\nperception = \"statistical\"");
    trained(&statistical, folder.path(), &["--decisions", "1"]);
    let with_errors = fs::read_to_string(run.join("curve.csv")).expect("a curve");
    let settings = fs::read_to_string(run.join("settings.json")).expect("settings");
    assert!(settings.contains("\"statistical\""), "{settings}");
    trained(&statistical, folder.path(), &["--decisions", "1"]);
    let again = fs::read_to_string(run.join("curve.csv")).expect("a curve");
    assert_eq!(with_errors, again);
    trained(TINY, folder.path(), &["--decisions", "1"]);
    let exact = fs::read_to_string(run.join("curve.csv")).expect("a curve");
    assert_ne!(with_errors, exact);

    let unknown = statistical.replace("statistical", "radar");
    let mut command = train(&unknown, folder.path(), &[]);
    let parts = ["config.toml", "line 6", "radar", "exact", "statistical"];
    assert_one_line_error(&mut command, &parts);
}

#[test]
fn a_training_may_see_with_the_networks() {
    let folder = tempfile::tempdir().expect("a folder");
    let network = (TINY.replace("steps = 8", "steps = 1\nperception = \"network\""))
        .replace("environments = 2", "environments = 1");
    let empty = tempfile::tempdir().expect("a folder");
    let models = empty.path().to_str().expect("a path");
    let mut command = train(&network, folder.path(), &["--models", models]);
    assert_one_line_error(&mut command, &["ufld-resnet18"]);
    let mut command = train(TINY, folder.path(), &["--models", models]);
    assert_one_line_error(&mut command, &["--models", "environment.perception"]);
    trained(&network, folder.path(), &["--decisions", "1"]);
    let file = folder.path().join("run/settings.json");
    let settings = fs::read_to_string(&file).expect("settings");
    assert!(settings.contains("\"network\""), "{settings}");

    let mut other: serde_json::Value = serde_json::from_str(&settings).expect("JSON");
    let hash = &mut other["networks"]["pointpillars"];
    assert_eq!(hash.as_str().map(str::len), Some(64), "{settings}");
    *hash = "0".repeat(64).into();
    fs::write(&file, other.to_string()).expect("written");
    let mut goes_on = train(&network, folder.path(), &["--resume"]);
    let parts = ["settings.json", "another networks.pointpillars", "--models"];
    assert_one_line_error(&mut goes_on, &parts);
    fs::write(&file, settings).expect("written");
    trained(&network, folder.path(), &["--resume", "--decisions", "3"]);
}

#[test]
fn other_settings_and_a_damaged_checkpoint_are_told() {
    let folder = tempfile::tempdir().expect("a folder");
    trained(TINY, folder.path(), &["--decisions", "1"]);
    let other = TINY.replace("neighbours = 3", "neighbours = 4");
    let mut goes_on = train(&other, folder.path(), &["--resume"]);
    assert_one_line_error(
        &mut goes_on,
        &["settings.json", "another environment.neighbours"],
    );
    let other = format!("{TINY}discount = 0.5\n");
    let mut goes_on = train(&other, folder.path(), &["--resume"]);
    assert_one_line_error(
        &mut goes_on,
        &["settings.json", "another training.hyperparameters.discount"],
    );

    let checkpoint = folder.path().join("run/checkpoint.safetensors");
    fs::write(&checkpoint, b"nothing of the kind").expect("a file");
    let mut goes_on = train(TINY, folder.path(), &["--resume"]);
    assert_one_line_error(&mut goes_on, &["checkpoint.safetensors"]);
}

#[test]
fn a_configuration_that_makes_no_sense_is_told_in_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let unknown = "environments = 1\nenvironmets = 2\n";
    let mut command = train(unknown, folder.path(), &[]);
    assert_one_line_error(&mut command, &["config.toml", "line 2", "environmets"]);
    let cases = [
        (TINY.replace("cavs = 2", "cavs = 0"), "ring.cavs"),
        (TINY.replace("cavs = 2", "cavs = 7"), "7"),
        (
            TINY.replace("vehicles = 6", "vehicles = 6\ndensity = 3.0"),
            "density is 3",
        ),
        (
            TINY.replace("environments = 2", "environments = 0"),
            "environments is 0",
        ),
        (TINY.replace("hidden = 16", "hidden = 0"), "hidden is 0"),
        (TINY.replace("steps = 8", "steps = 0"), "steps"),
    ];
    for (config, expected) in cases {
        assert_one_line_error(&mut train(&config, folder.path(), &[]), &[expected]);
    }
    let mut nowhere = covista();
    nowhere.args(["train", "--config", "/nowhere/config.toml"]);
    assert_one_line_error(&mut nowhere, &["/nowhere/config.toml"]);
}
