use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
    sync::OnceLock,
};

use serde_json::Value;
use tempfile::TempDir;

use crate::binary::{assert_one_line_error, covista};

const ALGORITHMS: [(&str, &str); 6] = [
    ("ours", "safe-actor-critic"),
    ("unshared", "safe-actor-critic"),
    ("maddpg-mapped", "maddpg-mapped"),
    ("maddpg", "maddpg"),
    ("end-to-end", "end-to-end"),
    ("end-to-end-unfiltered", "end-to-end"),
];

/// `covista train` of a tiny network for two rounds, with more settings of the environment.
fn train(algorithm: &str, out: &Path, environment: &str) {
    let config = out.with_extension("toml");
    let text = format!(
        "[environment]\nsteps = 3\nwatched = false\n{environment}\n\
         [environment.ring]\nvehicles = 6\ncavs = 3\n\
         [training]\nalgorithm = \"{algorithm}\"\nsharing = \"shared\"\n\
         [training.hyperparameters]\nhidden = 8\nminibatch = 4\nwarm_up = 4\nreplay = 100\n"
    );
    fs::write(&config, text).expect("written");
    let output = covista()
        .args(["train", "--decisions", "8", "--config"])
        .arg(&config)
        .arg("--out")
        .arg(out)
        .output()
        .expect("covista starts");
    assert!(output.status.success(), "{output:?}");
}

/// A folder with tiny policies, and what `covista train` wrote of each.
fn policies() -> &'static Path {
    static FOLDER: OnceLock<TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a folder");
        for (name, algorithm) in ALGORITHMS {
            let out = folder.path().join(name);
            let sharing = format!("sharing = {}", name != "unshared");
            let mode = match name {
                "maddpg" | "end-to-end-unfiltered" => "off",
                _ => "safe",
            };
            let how = format!("{sharing}\n[environment.control]\nmode = \"{mode}\"");
            train(algorithm, &out, &how);
            fs::copy(out.join("policy.safetensors"), policy(folder.path(), name)).expect("copied");
        }
        folder
    });
    folder.path()
}

fn policy(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!("policy-{name}.safetensors"))
}

fn experiment(name: &str, out: &Path, arguments: &[&str]) -> Command {
    let mut command = covista();
    command
        .args(["experiment", name, "--out"])
        .arg(out)
        .args(arguments);
    command
}

/// The same with the tiny policies.
fn learned(name: &str, out: &Path, arguments: &[&str]) -> Command {
    let mut command = experiment(name, out, arguments);
    command.arg("--policies").arg(policies());
    command
}

/// What it says.
fn run(command: &mut Command) -> String {
    let output = command.output().expect("covista starts");
    assert!(output.status.success(), "{output:?}");
    String::from_utf8(output.stdout).expect("text")
}

fn json(path: &Path) -> Value {
    let text = fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_slice(&text).expect("JSON")
}

fn rows(path: &Path) -> Vec<Value> {
    json(path)["rows"].as_array().expect("rows").clone()
}

/// The cases in a folder with their text.
fn cases(folder: &Path) -> Vec<(String, String)> {
    let mut cases: Vec<_> = (fs::read_dir(folder).expect("cases"))
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.file_name().is_some_and(|name| name != "plan.json"))
        .map(|path| {
            let name = path
                .file_name()
                .expect("a name")
                .to_string_lossy()
                .into_owned();
            (name, fs::read_to_string(path).expect("a case"))
        })
        .collect();
    cases.sort();
    cases
}

#[test]
fn cav_ratio_has_the_papers_column_beside_ours() {
    let out = tempfile::tempdir().expect("a folder");
    let copy = out.path().join("copy.json");
    let said = run(
        learned("cav-ratio", out.path(), &["--seeds", "2", "--episode", "2"])
            .arg("--json")
            .arg(&copy),
    );
    for part in [
        "paper",
        "60.06",
        "70.34",
        "rank correlation",
        "From 2 of at least 5 seeds",
        "cav-ratio.{json,md,png}",
    ] {
        assert!(said.contains(part), "no {part:?} in {said}");
    }
    let file = out.path().join("cav-ratio.json");
    assert_eq!(json(&file), json(&copy));
    let report = json(&file);
    assert_eq!(report["command"], "experiment cav-ratio");
    assert_eq!(
        report["settings"]["plan"]["options"]["seeds"]["first"],
        9000
    );
    assert_eq!(
        report["settings"]["claims"].as_array().map(Vec::len),
        Some(10)
    );
    let rows = rows(&file);
    assert_eq!(rows.len(), 5 * 7);
    for row in &rows {
        assert_eq!(row["seeds"], 2, "{row}");
        let velocity_mph = row["mean_velocity_mph"].as_f64().expect("a number");
        assert!((5.0..50.0).contains(&velocity_mph), "{row}");
        assert!((0.0..=3.0).contains(&row["mean_comfort"].as_f64().expect("a number")));
        assert_eq!(row["unsafe_actions"], 0.0, "{row}");
        let is_learned =
            ["ours", "maddpg-mapped"].contains(&row["algorithm"].as_str().expect("a name"));
        assert_eq!(
            row["paper_mean_velocity_mph"].is_number(),
            is_learned,
            "{row}"
        );
        // Without CAVs it is the same traffic for all.
        if row["cavs"] == 0.0 {
            assert_eq!(row["mean_velocity_mph"], rows[0]["mean_velocity_mph"]);
        }
    }
    assert_eq!(rows[6]["cav_ratio"], 1.0);
    assert_eq!(rows[6]["paper_mean_comfort"], 2.81);
    let picture = image::open(out.path().join("cav-ratio.png")).expect("a picture");
    assert_eq!(picture.width(), 1600);
    let text = fs::read_to_string(out.path().join("cav-ratio.md")).expect("Markdown");
    assert!(text.contains("| random-safe | 0.83 | 25 | 2 |"), "{text}");
}

#[test]
fn shards_on_any_number_of_threads_make_the_whole() {
    let [whole, parts] = [(); 2].map(|()| tempfile::tempdir().expect("a folder"));
    let options = ["--seeds", "9100-9101", "--episode", "3"];
    run(&mut learned("headway", whole.path(), &options));
    let part = |shard: &str, threads: &str| {
        let mut command = learned("headway", parts.path(), &options);
        run(command
            .args(["--shard", shard])
            .env("RAYON_NUM_THREADS", threads))
    };
    let first = part("1/3", "1");
    assert!(first.contains("2 of 4 cases"), "{first}");
    assert!(!parts.path().join("headway.json").exists());
    assert!(part("2/3", "3").contains("3 of 4 cases"));
    assert!(part("3/3", "2").contains("headway, m"));
    let folders = [&whole, &parts].map(|out| cases(&out.path().join("headway")));
    assert_eq!(folders[0], folders[1]);
    let files = [&whole, &parts].map(|out| rows(&out.path().join("headway.json")));
    assert_eq!(files[0], files[1]);
    assert_eq!(files[0][0]["paper_min_headway_m"], 18.5);
}

#[test]
fn what_has_been_driven_is_not_driven_again_unless_its_settings_change() {
    let out = tempfile::tempdir().expect("a folder");
    let options = ["--seeds", "1", "--episode", "2"];
    run(&mut learned("headway", out.path(), &options));
    let folder = out.path().join("headway");
    let name = &cases(&folder)[0].0;
    let case = folder.join(name);
    let mut marked = json(&case);
    marked["figures"]["loop"]["min_headway_m"] = 1234.5.into();
    let marked = marked.to_string();
    fs::write(&case, &marked).expect("written");
    let said = run(&mut learned("headway", out.path(), &options));
    assert!(said.contains("1234.5"), "{said}");
    assert_eq!(fs::read_to_string(&case).expect("a case"), marked);
    fs::remove_file(folder.join(&cases(&folder)[1].0)).expect("removed");
    assert!(run(&mut learned("headway", out.path(), &options)).contains("1234.5"));
    let said = run(&mut learned(
        "headway",
        out.path(),
        &["--seeds", "1", "--episode", "3"],
    ));
    assert!(!said.contains("1234.5"), "{said}");
    let marked_again = fs::read_to_string(&case)
        .expect("a case")
        .replace("\"version\": \"", "\"version\": \"0.");
    fs::write(
        &case,
        marked_again.replace("\"min_headway_m\": ", "\"min_headway_m\": 99"),
    )
    .expect("written");
    let said = run(&mut learned(
        "headway",
        out.path(),
        &["--seeds", "1", "--episode", "3"],
    ));
    assert!(!said.contains(" 99"), "{said}");
}

#[test]
fn without_the_mapping_unsafe_actions_are_taken() {
    let out = tempfile::tempdir().expect("a folder");
    run(&mut learned(
        "safety",
        out.path(),
        &["--seeds", "1", "--episode", "6"],
    ));
    let rows = rows(&out.path().join("safety.json"));
    assert_eq!(rows.len(), 4 * 9);
    let sum = |algorithm: &str, name: &str| -> u64 {
        let of = rows.iter().filter(|row| row["algorithm"] == algorithm);
        let of = of.map(|row| row[name].as_f64().expect("a number"));
        of.sum::<f64>().round() as u64
    };
    for ours in ["ours", "ours, exploring"] {
        assert_eq!(sum(ours, "unsafe_actions"), 0);
        assert_eq!(sum(ours, "violations_unattributed"), 0);
        assert_eq!(sum(ours, "decisions"), 9 * 18 * 6);
    }
    assert!(sum("maddpg", "unsafe_actions") > 0);
    assert!(sum("maddpg, exploring", "unsafe_actions") > 0);
    let driven = |name: &str, tenths: u64| {
        let name = format!("safety/{name}-cavs18-rho0.{tenths}0-seed9000.json");
        json(&out.path().join(name))["figures"].clone()
    };
    assert!((1..=9).any(|rho| driven("ours", rho) != driven("ours-exploring", rho)));
    assert_eq!(sum("maddpg, exploring", "paper_unsafe_actions"), 799_672);
}

#[test]
fn action_design_compares_behaviours_with_control_inputs() {
    let out = tempfile::tempdir().expect("a folder");
    let options = ["--seeds", "2", "--episode", "60"];
    let said = run(&mut learned("action-design", out.path(), &options));
    for part in ["steering reversals a km", "RMS lateral jerk: less with"] {
        assert!(said.contains(part), "no {part:?} in {said}");
    }
    let rows = rows(&out.path().join("action-design.json"));
    let names: Vec<_> = rows.iter().map(|row| &row["algorithm"]).collect();
    assert_eq!(names, ["ours", "end-to-end", "end-to-end-unfiltered"]);
    let [_, theirs, alone] = [0, 1, 2].map(|index| &rows[index]);
    // What has learnt nothing is soon beside the road.
    assert!(alone["time_s"].as_f64().expect("a time") < 30.0, "{alone}");
    assert_eq!(alone["filtered_share"], 0.0);
    for row in &rows[..2] {
        let number = |name: &str| row[name].as_f64().expect("a number");
        assert!(number("heading_rate_rms_degps") > 0.0, "{row}");
        assert!((0.0..=3.0).contains(&number("cav_mean_comfort")), "{row}");
        assert!((0.0..=100.0).contains(&number("filtered_share")), "{row}");
        assert!(
            number("collisions") + number("violations_unattributed") < 0.5,
            "{row}"
        );
    }
    // The filter holds in its lane who steers itself.
    assert_eq!(theirs["lane_changes_per_km"], 0.0);
    let case = json(
        &out.path()
            .join("action-design/end-to-end-cavs18-rho0.30-seed9000.json"),
    );
    assert_eq!(case["figures"]["loop"]["tally"]["decisions"], 18 * 60);
    let trace = &case["figures"]["loop"]["motion"]["trace"];
    assert!(
        trace.as_array().is_some_and(|trace| trace.len() > 30),
        "{trace}"
    );
    let picture = image::open(out.path().join("action-design.png")).expect("a picture");
    assert_eq!(picture.width(), 2400);
    // Other experiments' cases are written as they were.
    run(&mut learned(
        "headway",
        out.path(),
        &["--seeds", "1", "--episode", "2"],
    ));
    let (_, text) = &cases(&out.path().join("headway"))[0];
    assert!(!text.contains("motion"), "{text}");
}

#[test]
fn density_has_human_drivers_alone_beside_the_others() {
    let out = tempfile::tempdir().expect("a folder");
    run(&mut learned(
        "density",
        out.path(),
        &["--seeds", "1", "--episode", "2"],
    ));
    let rows = rows(&out.path().join("density.json"));
    for algorithm in ["ours", "idm", "maddpg"] {
        let of: Vec<_> = rows
            .iter()
            .filter(|row| row["algorithm"] == algorithm)
            .collect();
        assert_eq!(of.len(), 9);
        for row in of {
            let [flow, density] =
                ["flow", "density"].map(|name| row[name].as_f64().expect("a number"));
            let mph = row["mean_velocity_mph"].as_f64().expect("a number");
            assert!(
                (flow / (density * mph * 0.44704) - 1.0).abs() < 1e-9,
                "{row}"
            );
        }
    }
}

#[test]
fn obstacle_at_corner_compares_the_same_seeds_with_and_without_sharing() {
    let out = tempfile::tempdir().expect("a folder");
    for perception in ["truth", "statistical"] {
        run(&mut experiment(
            "obstacle-at-corner",
            out.path(),
            &[
                "--seeds",
                "1",
                "--episode",
                "26",
                "--perception",
                perception,
            ],
        ));
        let rows = rows(&out.path().join("obstacle-at-corner.json"));
        let sharing: Vec<_> = rows.iter().map(|row| row["sharing"].as_str()).collect();
        assert_eq!(sharing, [Some("on"), Some("off")]);
        // By 13 s those who were told have begun to change lane, the others have not.
        assert!(
            rows[0]["change_before_obstacle_m"]
                .as_f64()
                .expect("a place")
                > 40.0,
            "{rows:?}"
        );
        assert!(rows[1]["change_before_obstacle_m"].is_null(), "{rows:?}");
        assert!(
            rows.iter()
                .all(|row| row["delay_s"].as_f64().is_some_and(f64::is_finite))
        );
    }
    let plan = json(&out.path().join("obstacle-at-corner/plan.json"));
    assert_eq!(plan["options"]["percepts"], "statistical");
}

#[test]
fn percepts_may_come_from_the_networks() {
    let out = tempfile::tempdir().expect("a folder");
    let options = ["--seeds", "1", "--episode", "1", "--perception", "network"];
    run(&mut experiment("obstacle-at-corner", out.path(), &options));
    let plan = json(&out.path().join("obstacle-at-corner/plan.json"));
    assert_eq!(plan["options"]["percepts"], "network");
    for (name, text) in cases(&out.path().join("obstacle-at-corner")) {
        let case: Value = serde_json::from_str(&text).expect("JSON");
        let networks = &case["case"]["scene"]["networks"];
        assert_eq!(networks, &plan["networks"], "{name}");
        let hash = networks["pointpillars"].as_str().expect("a hash");
        assert_eq!(hash.len(), 64, "{name}");
    }
    let text = fs::read_to_string(out.path().join("obstacle-at-corner.md")).expect("a document");
    assert!(
        text.contains("perception by networks, pointpillars "),
        "{text}"
    );

    let nowhere = out.path().join("nowhere");
    let mut refused = learned("headway", out.path(), &options);
    refused.arg("--models").arg(&nowhere);
    assert_one_line_error(&mut refused, &["nowhere", "name the folder"]);
    let empty = tempfile::tempdir().expect("a folder");
    let mut refused = learned("headway", out.path(), &options);
    refused.arg("--models").arg(empty.path());
    assert_one_line_error(&mut refused, &["ufld-resnet18"]);
    assert!(!out.path().join("headway").exists());
    // Before anything is trained.
    let mut refused = experiment("headway", out.path(), &options);
    refused.arg("--retrain").arg("--models").arg(&nowhere);
    assert_one_line_error(&mut refused, &["nowhere", "name the folder"]);
    assert!(!out.path().join("policies").exists());
}

#[test]
fn truncation_has_the_errors_beside_the_bounds_and_goes_on_where_it_was() {
    let out = tempfile::tempdir().expect("a folder");
    let part = |shard: &str| {
        let options = ["--seeds", "1", "--shard", shard];
        run(&mut experiment("truncation", out.path(), &options))
    };
    assert!(part("1/2").contains("3 of 6 cases"));
    let said = part("2/2");
    assert!(
        said.contains("Theorem 2") && !said.contains("FAILS"),
        "{said}"
    );
    let report = json(&out.path().join("truncation.json"));
    let claims = report["settings"]["claims"].as_array().expect("claims");
    assert_eq!(claims.len(), 8);
    let rows = rows(&out.path().join("truncation.json"));
    assert_eq!(rows.len(), 3 * 2 * 6);
    for row in &rows {
        let number = |name: &str| row[name].as_f64().expect("a number");
        let (discount, kappa) = (number("discount"), number("kappa"));
        let bound = discount.powf(kappa / 2.0) / (1.0 - discount);
        assert!((number("bound_theorem_2") - bound).abs() < 1e-9, "{row}");
        let sharper = discount.powf((kappa / 2.0).floor() + 1.0) / (1.0 - discount);
        assert!((number("bound_proof") - sharper).abs() < 1e-9, "{row}");
        assert!(number("error_worst") <= sharper + 1e-9, "{row}");
        assert!(number("error_zeros").max(number("error_uniform")) <= number("error_worst"));
        let is_whole = kappa > 4.5;
        assert_eq!(number("error_worst") == 0.0, is_whole, "{row}");
        assert!(number("mean_error_zeros") <= number("error_zeros"), "{row}");
    }
    let picture = image::open(out.path().join("truncation.png")).expect("a picture");
    assert_eq!(picture.width(), 2400);
}

#[test]
fn on_the_loop_percepts_with_errors_make_cases_of_their_own() {
    let out = tempfile::tempdir().expect("a folder");
    for perception in ["truth", "statistical"] {
        run(&mut learned(
            "headway",
            out.path(),
            &["--seeds", "1", "--episode", "4", "--perception", perception],
        ));
    }
    let cases = cases(&out.path().join("headway"));
    let with_errors = cases
        .iter()
        .filter(|(name, _)| name.ends_with("-statistical.json"));
    assert_eq!((cases.len(), with_errors.clone().count()), (4, 2));
    for (name, text) in with_errors {
        assert!(
            text.contains("\"perception\": \"statistical\""),
            "{name}: {text}"
        );
        let exact = cases
            .iter()
            .find(|(other, _)| *other == name.replace("-statistical", ""));
        let (_, exact) = exact.expect("the exact one");
        assert!(!exact.contains("\"perception\""), "{exact}");
    }
    let text = fs::read_to_string(out.path().join("headway.md")).expect("a document");
    assert!(text.contains("statistical perception"), "{text}");
}

#[test]
fn learning_curves_are_read_or_made() {
    let out = tempfile::tempdir().expect("a folder");
    let given = |names: &[&str]| {
        let mut command = experiment("episode-reward", out.path(), &[]);
        for name in names {
            command.arg("--trained").arg(policies().join(name));
        }
        command
    };
    run(&mut given(&["ours", "maddpg"]));
    let rows_read = rows(&out.path().join("episode-reward.json"));
    let curve = fs::read_to_string(policies().join("ours/curve.csv")).expect("a curve");
    let rewards = curve
        .lines()
        .skip(1)
        .map(|line| line.split(',').nth(1).expect("a reward"));
    let largest = rewards
        .map(|reward| reward.parse::<f64>().expect("a number"))
        .fold(f64::MIN, f64::max);
    assert_eq!(rows_read[0]["largest_reward"].as_f64(), Some(largest));
    assert_eq!(rows_read[0]["paper_largest_reward"], 1940.0);
    assert_one_line_error(
        &mut given(&["ours"]),
        &["no training of maddpg", "--trained"],
    );
    assert_one_line_error(
        &mut given(&["ours", "ours", "maddpg"]),
        &["ours-seed0", "twice"],
    );
    assert_one_line_error(
        &mut given(&["elsewhere"]),
        &["settings.json", "covista train"],
    );

    let made = ["--seeds", "1", "--decisions", "6", "--episode", "2"];
    run(&mut experiment("episode-reward", out.path(), &made));
    let case = json(&out.path().join("episode-reward/maddpg-seed9000.json"));
    let rewards = case["figures"]["training"]["reward"]
        .as_array()
        .expect("rewards");
    assert_eq!(rewards.len(), 2);
}

#[test]
fn policies_are_trained_anew_on_request() {
    let out = tempfile::tempdir().expect("a folder");
    let options = [
        "--seeds",
        "1",
        "--episode",
        "2",
        "--retrain",
        "--decisions",
        "1",
    ];
    run(&mut experiment("headway", out.path(), &options));
    for name in ["ours", "maddpg"] {
        assert!(
            policy(&out.path().join("policies"), name).is_file(),
            "{name}"
        );
    }
    let plan = json(&out.path().join("headway/plan.json"));
    assert_eq!(plan["policies"]["ours"].as_str().map(str::len), Some(64));
}

#[test]
fn a_report_has_every_experiment_on_one_page() {
    let out = tempfile::tempdir().expect("a folder");
    let report = || {
        let mut command = covista();
        command.arg("report").arg(out.path());
        command
    };
    let options = ["--seeds", "1", "--episode", "2"];
    run(&mut learned("headway", out.path(), &options));
    run(learned("safety", out.path(), &options).args(["--shard", "1/2"]));
    let said = run(&mut report());
    assert!(said.contains("headway: 2 of 2 cases"), "{said}");
    assert!(said.contains("safety: 18 of 36 cases"), "{said}");
    let page = fs::read_to_string(out.path().join("report.html")).expect("a page");
    assert_eq!(page.matches("src=\"data:image/png;base64,").count(), 2);
    assert!(
        !page.contains("src=\"http") && !page.contains("href="),
        "not self-contained"
    );
    for part in [
        "18 cases are missing",
        "ours-cavs18-rho0.20-seed9000",
        "<td>18.5</td>",
        "min_headway_m",
    ] {
        assert!(page.contains(part), "no {part:?}");
    }
    assert!(
        !page.contains("ours-cavs18-rho0.10-seed9000,"),
        "it is there"
    );

    let case = out
        .path()
        .join("headway")
        .join(&cases(&out.path().join("headway"))[0].0);
    let whole = fs::read_to_string(&case).expect("a case");
    fs::write(&case, &whole[..whole.len() / 2]).expect("written");
    let name = case.file_name().expect("a name").to_str().expect("text");
    for command in [&mut report(), &mut learned("headway", out.path(), &options)] {
        assert_one_line_error(command, &[name, "damaged", "delete it"]);
    }
}

#[test]
fn a_report_of_nothing_is_refused() {
    let out = tempfile::tempdir().expect("a folder");
    for folder in [out.path().to_owned(), out.path().join("nowhere")] {
        assert_one_line_error(
            covista().arg("report").arg(folder),
            &["no experiment", "covista experiment"],
        );
    }
}

#[test]
fn what_makes_no_experiment_is_refused_in_one_line() {
    let out = tempfile::tempdir().expect("a folder");
    let refused: [(&[&str], &[&str]); 15] = [
        (&["moon-landing"], &["moon-landing", "cav-ratio", "density"]),
        (&["safety", "--shard", "0/3"], &["0/3", "I from 1 to N"]),
        (&["safety", "--shard", "4/3"], &["4/3", "I from 1 to N"]),
        (&["safety", "--shard", "first"], &["first", "I from 1 to N"]),
        (&["safety", "--seeds", "0"], &["--seeds", "9000-9009"]),
        (&["safety", "--seeds", "7-3"], &["7-3", "9000-9009"]),
        (&["safety", "--episode", "0"], &["--episode"]),
        (
            &["safety", "--perception", "truth", "--trained", "x"],
            &["--trained", "episode-reward"],
        ),
        (
            &["safety", "--models", "x"],
            &["--models", "--perception network"],
        ),
        (
            &["truncation", "--perception", "statistical"],
            &["--perception", "game on paper"],
        ),
        (
            &["episode-reward", "--perception", "statistical"],
            &["--perception", "environment.perception", "--trained"],
        ),
        (
            &["headway", "--decisions", "9"],
            &["--decisions", "--retrain"],
        ),
        (
            &["episode-reward", "--trained", "x", "--episode", "9"],
            &["--trained", "--episode"],
        ),
        (
            &["obstacle-at-corner", "--retrain"],
            &["--retrain", "has none"],
        ),
        (
            &["truncation", "--episode", "5"],
            &["--episode", "truncation computes"],
        ),
    ];
    for (arguments, parts) in refused {
        let mut command = covista();
        command
            .arg("experiment")
            .args(arguments)
            .arg("--out")
            .arg(out.path());
        assert_one_line_error(&mut command, parts);
    }
    assert!(!out.path().join("safety").exists());
}

#[test]
fn a_policy_that_is_missing_or_does_not_fit_is_named() {
    let (out, other) = (tempfile::tempdir(), tempfile::tempdir());
    let (out, other) = (out.expect("a folder"), other.expect("a folder"));
    let refuse = |parts: &[&str]| {
        let mut command = experiment("safety", out.path(), &["--seeds", "1", "--episode", "1"]);
        assert_one_line_error(command.arg("--policies").arg(other.path()), parts);
    };
    refuse(&["policy-ours.safetensors", "--policies", "--retrain"]);
    let (ours, maddpg) = (policy(other.path(), "ours"), policy(other.path(), "maddpg"));
    fs::copy(policy(policies(), "maddpg"), &ours).expect("copied");
    refuse(&["policy-ours.safetensors", "maddpg"]);
    let whole = fs::read(policy(policies(), "ours")).expect("a policy");
    fs::write(&ours, &whole[..whole.len() - 5]).expect("written");
    refuse(&["policy-ours.safetensors", "damaged"]);
    fs::write(&ours, whole).expect("written");
    refuse(&["policy-maddpg.safetensors", "--policies"]);
    let filtered = other.path().join("filtered");
    train("maddpg", &filtered, "");
    fs::copy(filtered.join("policy.safetensors"), &maddpg).expect("copied");
    refuse(&["policy-maddpg.safetensors", "with the safety filter"]);
    fs::copy(policy(policies(), "maddpg"), &maddpg).expect("copied");
    train(
        "safe-actor-critic",
        &other.path().join("few"),
        "neighbours = 2",
    );
    fs::copy(other.path().join("few/policy.safetensors"), &ours).expect("copied");
    refuse(&["policy-ours.safetensors", "2 neighbours", "the loop has"]);
}
