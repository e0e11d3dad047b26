//! `covista bench perception`: how fast the networks are, alone and end to end.

mod contest;
mod frontier;
mod member;
mod peer;
mod rows;
mod tables;

use std::{collections::BTreeSet, path::Path};

use anyhow::bail;
use covista_drive::{recorded_bench_frames, rendered_frames};
use covista_perception::{
    BenchFrame, DETECTOR_MODEL, LANE_MODEL, Network, OnnxRuntime, Precision, Provider,
    ProviderChoice, SessionSettings, list_models,
};
use covista_sensors::kitti::kitti_frames;
use covista_viewer::plot_frontier;
use covista_world::CameraIntrinsics;
use serde_json::json;

use crate::{
    cli::{PeerArg, PerceptionBenchArgs},
    dataset::frame_bar,
    output::{Report, models_folder, prepare_file, say, write_json},
};
use contest::{Contest, Contestant, Pair, TURN_FRAMES, WARM_UP_FRAMES};
use peer::{Peer, write_frames, write_inputs};

/// Frames that are rendered, or at most read from `--data`.
const FRAMES: usize = 20;

/// `covista bench perception`.
pub(super) fn run(args: &PerceptionBenchArgs) -> anyhow::Result<()> {
    for file in [&args.json, &args.plot].into_iter().flatten() {
        prepare_file(file)?;
    }
    let cores = std::thread::available_parallelism().map_or(1, Into::into);
    let threads = args.threads.map_or(cores, Into::into);
    let models = models_folder(args.models.as_deref());
    let mut contest = open(args, &models, threads)?;
    let folder = tempfile::tempdir()?;
    for &kind in &args.against {
        if contest.peers.iter().all(|peer| peer.kind != kind) {
            contest.peers.push(Peer::start(kind, folder.path())?);
        }
    }
    let frames = frames(args.data.as_deref(), &contest)?;
    introduce(&mut contest, &frames, &models, folder.path(), threads)?;

    let bar = frame_bar();
    let repetitions = args.repetitions.get();
    contest.hold(&frames, repetitions, &|done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();

    let rows = rows::rows(&contest, threads);
    let peers: Vec<String> = contest
        .peers
        .iter()
        .map(|peer| format!("{} ({})", peer.kind.name(), peer.versions))
        .collect();
    say(&heading(args, threads, frames.len(), &peers))?;
    for table in [
        tables::speed_table(&rows),
        tables::network_table(&rows),
        tables::file_table(&rows),
    ] {
        say(&format!("\n{}", table.trim_end()))?;
    }
    if !peers.is_empty() {
        say(&format!("\n{}", tables::peer_table(&rows).trim_end()))?;
    }
    if let Some(plot) = &args.plot {
        let is_detector = |id: &str| {
            let mut of_id = contest.contestants.iter().filter(|of| of.id() == id);
            of_id.any(|of| of.network.is_detector())
        };
        plot_frontier(plot, &frontier::panels(&rows, is_detector), frontier::PAPER)?;
    }
    let Some(json) = &args.json else {
        return Ok(());
    };
    let settings = json!({
        "threads": threads,
        "frames": frames.len(),
        "frames_from": args.data.as_ref().map_or("rendered".into(), |data| data.display().to_string()),
        "counted_frames": repetitions,
        "frames_of_a_turn": TURN_FRAMES,
        "warm_up_frames_of_a_turn": WARM_UP_FRAMES,
        "against": peers,
    });
    write_json(
        json,
        &Report::new("bench perception", rows).with_settings(settings),
    )
}

/// What was measured, and how.
fn heading(args: &PerceptionBenchArgs, threads: usize, frames: usize, peers: &[String]) -> String {
    let source = match &args.data {
        Some(data) => format!("of {}", data.display()),
        None => "rendered with KITTI's rig".to_owned(),
    };
    let against = match peers {
        [] => String::new(),
        peers => format!("; against {}", peers.join(" and ")),
    };
    format!(
        "{threads} threads; {} frames each, cycling through {frames} {source}, in turns of \
         {TURN_FRAMES} after {WARM_UP_FRAMES} that don't count, everybody's turn in every round\
         {against}",
        args.repetitions
    )
}

/// Opens every network that is asked for on every provider, and the closed loop's pair where both
/// of its networks are among them.
fn open(args: &PerceptionBenchArgs, models: &Path, threads: usize) -> anyhow::Result<Contest> {
    let mut ids: Vec<String> = args.model.clone();
    if ids.is_empty() {
        ids = list_models(models)?
            .into_iter()
            .map(|card| card.id)
            .collect();
    }
    if ids.is_empty() {
        bail!(
            "no model card (*.toml) in {}; name the folder with --models",
            models.display()
        );
    }
    let mut seen = BTreeSet::new();
    ids.retain(|id| seen.insert(id.clone()));
    let progress = |message: &str| eprintln!("covista: {message}");
    let runtime = OnnxRuntime::acquire(&progress)?;
    let mut contest = Contest::default();
    for provider in providers(args, &runtime, &progress)? {
        let settings = SessionSettings { provider, threads };
        for id in &ids {
            let contestant = Contestant::open(&runtime, models, id, settings)?;
            contest.contestants.push(contestant);
        }
        let of = |id: &str| {
            let mut opened = contest.contestants.iter().rev();
            opened
                .find(|of| of.id() == id)
                .map(|of| of.network.precision())
        };
        if let (Some(precision), Some(_)) = (of(DETECTOR_MODEL), of(LANE_MODEL)) {
            let pair = Pair::open(&runtime, models, settings, precision)?;
            contest.pairs.push(pair);
        }
    }
    Ok(contest)
}

/// The providers that are asked for, or cpu and the fastest there is.
fn providers(
    args: &PerceptionBenchArgs,
    runtime: &OnnxRuntime,
    progress: &dyn Fn(&str),
) -> anyhow::Result<Vec<Provider>> {
    let default = [ProviderChoice::Only(Provider::Cpu), ProviderChoice::Auto];
    let asked = match &*args.provider {
        [] => &default[..],
        asked => asked,
    };
    let mut providers = Vec::new();
    for &choice in asked {
        let provider = runtime.provide(choice, progress)?;
        if !providers.contains(&provider) {
            providers.push(provider);
        }
    }
    Ok(providers)
}

/// Frames of a folder, or rendered ones.
fn frames(data: Option<&Path>, contest: &Contest) -> anyhow::Result<Vec<BenchFrame>> {
    let Some(folder) = data else {
        return Ok(rendered_frames(FRAMES as u64));
    };
    let lanes = contest
        .contestants
        .iter()
        .find_map(|of| match &of.network.card().network {
            Network::Ufld(spec) => Some([spec.image_width_px, spec.image_height_px]),
            Network::PointPillars(_) => None,
        });
    let kitti = [
        CameraIntrinsics::KITTI.width_px,
        CameraIntrinsics::KITTI.height_px,
    ];
    let size_px = lanes.unwrap_or(kitti);
    Ok(recorded_bench_frames(
        &kitti_frames(folder)?,
        size_px,
        FRAMES,
    )?)
}

/// Makes the frames and the networks on the provider cpu known to the peers.
fn introduce(
    contest: &mut Contest,
    frames: &[BenchFrame],
    models: &Path,
    folder: &Path,
    threads: usize,
) -> anyhow::Result<()> {
    if contest.peers.is_empty() {
        return Ok(());
    }
    write_frames(frames, folder)?;
    for contestant in &mut contest.contestants {
        if contestant.provider != Provider::Cpu {
            continue;
        }
        write_inputs(&mut contestant.network, frames, folder)?;
        let card = models.join(format!("{}.toml", contestant.id()));
        for (index, peer) in contest.peers.iter_mut().enumerate() {
            let is_int8 = contestant.network.precision() == Precision::Int8;
            if is_int8 && peer.kind == PeerArg::Pytorch {
                continue;
            }
            let network = peer.open(&contestant.network, &card, folder, threads)?;
            contestant.add_other(index, network);
        }
    }
    Ok(())
}
