use covista_drive::*;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let steps: u64 = a[1].parse().unwrap();
    let seed: u64 = a[2].parse().unwrap();
    let spec = CampaignSpec {
        seed,
        steps,
        control: ControlSettings::default(),
        broken: None,
        plant: PlantModel::Kinematic,
    };
    let t = std::time::Instant::now();
    match a.get(3).map(String::as_str) {
        Some("broken") => {
            for b in Broken::ALL {
                let found = run_campaign(
                    &CampaignSpec {
                        broken: Some(b),
                        ..spec.clone()
                    },
                    &|_| {},
                )
                .unwrap();
                let mut all = Tally::default();
                for (_, t) in &found {
                    all.add(t);
                }
                println!(
                    "{} v {} rear {} {:?} lc {} named {:?} {:?}",
                    b.name(),
                    all.violations,
                    all.rear_gap_breaches,
                    all.rear_cause,
                    all.lane_changes,
                    all.most_frequent_cause(),
                    all.cause
                );
            }
        }
        Some("plant") => {
            for c in cover_plants(&spec.control, seed, steps, &|_| {}).unwrap() {
                println!("{c:#?}");
            }
        }
        Some("time") => {
            for c in time_control(&spec.control, seed, steps as usize, &|_| {}).unwrap() {
                println!("{c:?}");
            }
        }
        Some("episode") => {
            for f in Family::ALL {
                if f.name() == a[4] {
                    trace_episode(&spec, f, a[5].parse().unwrap());
                }
            }
        }
        _ => {
            for (f, t) in run_campaign(&spec, &|_| {}).unwrap() {
                println!("{} {t:#?}", f.name());
            }
        }
    }
    eprintln!("{:.1} s", t.elapsed().as_secs_f64());
}
