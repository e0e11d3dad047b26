use super::*;

fn refusal(text: &str) -> String {
    let said = ErrorModel::parse(text, "my.toml")
        .expect_err("refused")
        .to_string();
    assert!(!said.contains('\n') && said.contains("my.toml"), "{said}");
    said
}

#[test]
fn the_built_in_errors_are_read_and_survive_being_written() {
    let model = ErrorModel::builtin().expect("the built-in errors");
    let text = model.to_toml().expect("TOML");
    assert_eq!(ErrorModel::parse(&text, "again").expect("the same"), model);
}

type Change = &'static dyn Fn(&mut ErrorModel);

#[test]
fn what_makes_no_sense_is_refused_by_name() {
    let model = ErrorModel::builtin().expect("the built-in errors");
    let with = |change: Change| {
        let mut changed = model.clone();
        change(&mut changed);
        refusal(&changed.to_toml().expect("TOML"))
    };
    let cases: [(&str, Change); 9] = [
        ("recall of vehicle 2", &|model| {
            model.vehicles[1].recall = 1.2;
        }),
        ("flipped of vehicle 1", &|model| {
            model.vehicles[0].flipped = f64::NAN;
        }),
        ("along_m of vehicle 1", &|model| {
            model.vehicles[0].along_m.0.reverse();
        }),
        ("distance_m of vehicle 1", &|model| {
            model.vehicles[0].distance_m = [20.0, 20.0];
        }),
        ("car and truck", &|model| {
            let is_car = |row: &VehicleErrors| row.class == ObjectClass::Car;
            model.vehicles.retain(is_car);
        }),
        ("found_s of lasting", &|model| {
            model.lasting.found_s = f64::INFINITY;
        }),
        ("ahead of lanes", &|model| model.lanes.ahead[0].none = 1.1),
        ("place of false_boxes", &|model| {
            model.false_boxes.places[0].per_frame = -0.1;
        }),
        ("range_m", &|model| model.range_m.reverse()),
    ];
    for (part, change) in cases {
        let said = with(change);
        assert!(said.contains(part), "no {part:?} in: {said}");
    }
}

#[test]
fn unknown_and_missing_fields_are_named_with_their_line() {
    let text = format!("colour = 1\n{BUILTIN}");
    let said = refusal(&text);
    assert!(said.contains("colour") && said.contains("line 1"), "{said}");
    let said = refusal(&BUILTIN.replacen("recall", "recal", 1));
    assert!(said.contains("recal"), "{said}");
    let said = refusal("");
    assert!(said.contains("range_m"), "{said}");
}
