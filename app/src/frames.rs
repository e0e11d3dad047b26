use std::{collections::BTreeMap, path::Path};

use anyhow::bail;
use covista_drive::{Networks, calibration_of};
use covista_perception::{
    DETECTOR_MODEL, Detector, LANE_MODEL, LaneFinder, OnnxRuntime, Perceiver, Provider,
    ProviderChoice, SessionSettings, list_models,
};
use covista_sensors::{
    ErrorModel,
    kitti::{KittiFrame, kitti_frames},
};

use crate::{cli::ProviderArg, output::models_folder};

/// The recorded frames at `path`: those of a folder in KITTI's layout or the one of a single file,
/// with the files named for it.
pub fn recorded_frames(
    path: &Path,
    calibration: Option<&Path>,
    labels: Option<&Path>,
) -> anyhow::Result<Vec<KittiFrame>> {
    if path.is_dir() {
        if calibration.is_some() || labels.is_some() {
            bail!(
                "--calibration and --labels are for a single file; {} is a folder with its own",
                path.display()
            );
        }
        return Ok(kitti_frames(path)?);
    }
    let mut frame = KittiFrame::of_file(path)?;
    if let Some(calibration) = calibration {
        frame.calibration = Some(calibration.to_owned());
        // A file that is named is to be usable, whether or not it turns out to be needed.
        calibration_of(&frame)?;
    }
    if let Some(labels) = labels {
        frame.labels = Some(labels.to_owned());
    }
    Ok(vec![frame])
}

/// Both networks on all cores.
pub fn perceiver(models: Option<&Path>, provider: ProviderArg) -> anyhow::Result<Perceiver> {
    let (runtime, settings) = runtime(provider)?;
    Ok(Perceiver::new(&runtime, &models_folder(models), settings)?)
}

/// The lane network `id` on all cores.
pub fn lane_finder(
    models: Option<&Path>,
    id: &str,
    provider: ProviderArg,
) -> anyhow::Result<LaneFinder> {
    let (runtime, settings) = runtime(provider)?;
    let folder = models_folder(models);
    Ok(LaneFinder::open(&runtime, &folder, id, settings)?)
}

/// The detector `id` on all cores.
pub fn detector(
    models: Option<&Path>,
    id: &str,
    provider: ProviderArg,
) -> anyhow::Result<Detector> {
    let (runtime, settings) = runtime(provider)?;
    let folder = models_folder(models);
    Ok(Detector::open(&runtime, &folder, id, settings)?)
}

/// ONNX Runtime with the provider that is asked for, and as many threads as there are cores.
fn runtime(asked: ProviderArg) -> anyhow::Result<(OnnxRuntime, SessionSettings)> {
    let say = |message: &str| eprintln!("covista: {message}");
    let runtime = OnnxRuntime::acquire(&say)?;
    let provider = runtime.provide(asked.provider, &say)?;
    if asked.provider == ProviderChoice::Auto {
        let hint = match provider {
            Provider::Cpu => "; --provider openvino would be fetched",
            _ => "",
        };
        say(&format!(
            "the networks run on the provider {provider}{hint}"
        ));
    }
    let threads = std::thread::available_parallelism().map_or(1, Into::into);
    Ok((runtime, SessionSettings { provider, threads }))
}

/// Both networks on one thread each, for a frame a core at a time but no more than `most`.
pub fn networks(
    models: Option<&Path>,
    most: usize,
    provider: ProviderArg,
) -> anyhow::Result<Networks> {
    let (runtime, settings) = runtime(provider)?;
    let alone = SessionSettings {
        threads: 1,
        ..settings
    };
    let at_once = settings.threads.min(most);
    Ok(Networks::open(
        &runtime,
        &models_folder(models),
        alone,
        at_once,
    )?)
}

/// The hashes of the two networks that the closed loop runs, by their ids.
pub fn network_hashes(models: Option<&Path>) -> anyhow::Result<BTreeMap<String, String>> {
    let cards = list_models(&models_folder(models))?.into_iter();
    let in_use = cards.filter(|card| [DETECTOR_MODEL, LANE_MODEL].contains(&card.id.as_str()));
    Ok(in_use.map(|card| (card.id, card.sha256)).collect())
}

/// The networks' errors in a file, or those that come with covista.
pub fn error_model(file: Option<&Path>) -> anyhow::Result<ErrorModel> {
    Ok(match file {
        Some(file) => ErrorModel::load(file)?,
        None => ErrorModel::builtin()?,
    })
}
