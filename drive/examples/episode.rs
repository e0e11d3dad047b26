//! One episode of the adversarial campaign again: what was drawn, and what was found when.
//!
//! `cargo run --release -p covista-drive --example episode -- SEED FAMILY NUMBER [BROKEN]`, with
//! the names that `covista bench control --json` gives as `first_bad_episode`.

#![expect(clippy::print_stdout, reason = "what an example has to say")]

use covista_drive::{
    Broken, CampaignSpec, ControlSettings, EpisodeId, Family, Nominals, PlantModel, look_at_episode,
};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [seed, family, number, broken @ ..] = words.as_slice() else {
        return Err("SEED FAMILY NUMBER [BROKEN]".into());
    };
    let family = Family::ALL.into_iter().find(|known| known.name() == family);
    let named = |name: &String| Broken::ALL.into_iter().find(|known| known.name() == name);
    let spec = CampaignSpec {
        seed: seed.parse()?,
        steps: 0,
        control: ControlSettings::default(),
        broken: broken.first().and_then(named),
        nominal: Nominals::All,
        plant: PlantModel::Kinematic,
    };
    let id = EpisodeId {
        family: family.ok_or("no such family")?,
        number: number.parse()?,
    };
    let (tally, lines) = look_at_episode(&spec, id)?;
    lines.iter().for_each(|line| println!("{line}"));
    println!("{tally:#?}");
    Ok(())
}
