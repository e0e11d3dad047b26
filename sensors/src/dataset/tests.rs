use std::path::Path;
use std::path::PathBuf;

use covista_traffic::sample_scene;

use super::folder::sha256_hex;
use super::*;

fn spec(out: &Path) -> DatasetSpec {
    DatasetSpec {
        seed: 5,
        // A coarse sweep is as good here.
        lidar: crate::Lidar {
            columns: 90,
            ..crate::Lidar::hdl64e()
        },
        ..DatasetSpec::new(out.to_owned(), 2)
    }
}

fn go_on(_: usize, _: usize) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// Names and contents of all files, by name.
fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    fn collect(root: &Path, folder: &Path, files: &mut Vec<(PathBuf, Vec<u8>)>) {
        for entry in std::fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                collect(root, &path, files);
            } else {
                let name = path.strip_prefix(root).expect("inside").to_owned();
                files.push((name, std::fs::read(path).expect("a file")));
            }
        }
    }
    let mut files = Vec::new();
    collect(folder, folder, &mut files);
    files.sort();
    files
}

#[test]
fn a_data_set_is_the_same_with_any_number_of_threads_and_after_an_interruption() {
    let root = tempfile::tempdir().expect("a folder");
    let write = |name: &str, threads: usize| {
        let out = root.path().join(name);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("a pool")
            .install(|| write_dataset(&spec(&out), go_on))
            .expect("a data set");
        contents(&out)
    };
    let one = write("one", 1);
    // Six files a frame; manifest, label_data and ImageSets.
    assert_eq!(one.len(), 6 * 2 + 3);
    assert_eq!(one, write("three", 3));

    let inside = |name: &str| root.path().join("one").join(name);
    std::fs::remove_file(inside("scenes/000001.json")).expect("removed");
    std::fs::write(inside("velodyne/000001.bin"), b"torn").expect("written");
    std::fs::remove_file(inside("image_2/000000.png")).expect("removed");
    std::fs::create_dir(inside(".partial")).expect("made");
    std::fs::write(inside(".partial/velodyne-000001.bin"), b"torn").expect("written");
    assert_eq!(one, write("one", 2));
}

#[test]
fn the_manifest_has_the_hash_of_every_file() {
    let root = tempfile::tempdir().expect("a folder");
    let manifest = write_dataset(&spec(root.path()), go_on).expect("a data set");
    assert_eq!((manifest.version, manifest.frames), (2, 2));
    assert_eq!(manifest.files.len(), 12);
    for (name, hash) in &manifest.files {
        let content = std::fs::read(root.path().join(name)).expect("a file");
        assert_eq!(hash, &sha256_hex(&content), "{name}");
    }
    let text = std::fs::read_to_string(root.path().join("manifest.json")).expect("a file");
    assert_eq!(
        serde_json::from_str::<Manifest>(&text).expect("a manifest"),
        manifest
    );
}

#[test]
fn stopped_it_lists_what_is_finished_and_goes_on_later() {
    let root = tempfile::tempdir().expect("a folder");
    let four = DatasetSpec {
        frames: 4,
        ..spec(root.path())
    };
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let one_thread = one_thread.expect("a pool");
    let stop = |done: usize, _: usize| match done {
        3 => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    };
    let stopped = one_thread.install(|| write_dataset(&four, stop));
    let said = stopped.expect_err("stopped").to_string();
    assert!(said.contains("3 of 4 frames"), "{said}");
    let read = |name: &str| std::fs::read_to_string(root.path().join(name)).expect("a file");
    assert_eq!(read("ImageSets/train.txt"), "000000\n000001\n000002\n");
    assert_eq!(read("label_data.json").lines().count(), 3);
    assert!(!root.path().join(".partial").exists());

    let manifest = write_dataset(&four, go_on).expect("the rest");
    assert_eq!(manifest.frames, 4);
    // Fewer than there are: the lists still cover what is there.
    let manifest = write_dataset(&spec(root.path()), go_on).expect("nothing to do");
    assert_eq!(manifest.frames, 4);
    assert_eq!(read("ImageSets/train.txt").lines().count(), 4);
}

#[test]
fn what_can_not_be_written_leaves_no_half_frame() {
    let root = tempfile::tempdir().expect("a folder");
    // A folder with something in it can't be replaced by a file.
    let taken = root.path().join("label_2/000001.txt");
    write_dataset(
        &DatasetSpec {
            frames: 1,
            ..spec(root.path())
        },
        go_on,
    )
    .expect("a frame");
    std::fs::create_dir_all(taken.join("inside")).expect("made");
    let said = write_dataset(&spec(root.path()), go_on)
        .expect_err("refused")
        .to_string();
    assert!(said.contains("label_2/000001.txt"), "{said}");
    assert!(!root.path().join("velodyne/000001.bin").exists());
    let listed = std::fs::read_to_string(root.path().join("ImageSets/train.txt"));
    assert_eq!(listed.expect("a list"), "000000\n");
}

#[test]
fn splits_share_nothing_and_a_foreign_folder_is_left_alone() {
    let root = tempfile::tempdir().expect("a folder");
    let train = spec(root.path());
    let val = DatasetSpec {
        split: Split::Val,
        ..train.clone()
    };
    let scene = |spec| sample_scene(FrameMaker::new(spec).scene_seed, 0).scene;
    assert_ne!(format!("{:?}", scene(&train)), format!("{:?}", scene(&val)));

    let held = Folder::claim(&train).expect("an empty folder");
    let busy = write_dataset(&train, go_on).expect_err("refused");
    assert!(matches!(busy, DatasetError::Busy { .. }), "{busy}");
    drop(held);
    let refused = |spec: &DatasetSpec, what: &str| {
        let said = write_dataset(spec, go_on).expect_err("refused").to_string();
        assert!(
            said.contains(what) && said.contains("choose another folder"),
            "{said}"
        );
    };
    refused(&val, "another split");
    refused(
        &DatasetSpec {
            seed: 6,
            ..train.clone()
        },
        "another seed",
    );
    let formats = [Format::Kitti].into();
    refused(
        &DatasetSpec {
            formats,
            ..train.clone()
        },
        "other formats",
    );
    assert!(Folder::claim(&train).is_ok());

    std::fs::write(root.path().join("manifest.json"), r#"{"version": 1}"#).expect("written");
    refused(&train, "another version");
    std::fs::remove_file(root.path().join("manifest.json")).expect("removed");
    std::fs::write(root.path().join("velodyne/000000.bin"), [0; 16]).expect("written");
    refused(&train, "frames that this program has not written");
}

#[test]
fn frames_beyond_six_digits_are_refused_and_leave_nothing() {
    let root = tempfile::tempdir().expect("a folder");
    for (start, frames) in [(0, u64::MAX), (999_999, 2), (u64::MAX, 1)] {
        let out = root.path().join("data");
        let many = DatasetSpec {
            start,
            frames,
            ..spec(&out)
        };
        let said = write_dataset(&many, go_on)
            .expect_err("refused")
            .to_string();
        assert!(said.contains("six digits"), "{said}");
        assert!(!out.exists());
    }
}

#[test]
fn only_the_formats_asked_for_are_written() {
    let root = tempfile::tempdir().expect("a folder");
    let formats = [Format::TuSimple].into();
    let tusimple = DatasetSpec {
        formats,
        ..spec(root.path())
    };
    let manifest = write_dataset(&tusimple, go_on).expect("a data set");
    let folders = ["image_2", "lanes", "scenes"];
    assert!(
        manifest
            .files
            .keys()
            .all(|file| { folders.iter().any(|folder| file.starts_with(folder)) })
    );
    assert!(root.path().join("label_data.json").is_file());
    assert!(!root.path().join("velodyne").exists());
}

#[test]
fn an_mcap_file_holds_the_frames_as_ros_2_messages() {
    let root = tempfile::tempdir().expect("a folder");
    let formats = [Format::Mcap].into();
    let mcap = DatasetSpec {
        formats,
        ..spec(root.path())
    };
    write_dataset(&mcap, go_on).expect("a data set");
    let bytes = std::fs::read(root.path().join("frames.mcap")).expect("a file");
    let messages: Vec<_> = ::mcap::MessageStream::new(&bytes)
        .expect("an MCAP file")
        .collect::<Result<_, _>>()
        .expect("messages");
    assert_eq!(messages.len(), 2 * 5);
    for message in &messages {
        let schema = message.channel.schema.as_ref().expect("a schema");
        assert_eq!(
            (schema.encoding.as_str(), &*message.channel.message_encoding),
            ("ros2msg", "cdr")
        );
    }
    let clouds = messages
        .iter()
        .filter(|message| message.channel.topic == "/lidar/points");
    for (index, cloud) in clouds.enumerate() {
        assert_eq!(cloud.log_time, index as u64 * 100_000_000);
        let points = std::fs::read(root.path().join(format!("velodyne/{index:06}.bin")));
        let points = points.expect("a file");
        let tail = &cloud.data[cloud.data.len() - 1 - points.len()..];
        assert_eq!(&tail[..points.len()], points);
    }
}

#[test]
fn truth_of_points_and_pixels_is_written_on_request() {
    let root = tempfile::tempdir().expect("a folder");
    let truth = [TruthFile::Points, TruthFile::Depth, TruthFile::Instance].into();
    write_dataset(
        &DatasetSpec {
            truth,
            ..spec(root.path())
        },
        go_on,
    )
    .expect("a data set");
    for frame in 0..2 {
        let read = |name: String| std::fs::read(root.path().join(name)).expect("a file");
        let points = read(format!("velodyne/{frame:06}.bin")).len() / 16;
        let labels = read(format!("labels/{frame:06}.label"));
        assert_eq!(labels.len(), 4 * points);
        let record = read(format!("scenes/{frame:06}.json"));
        let record: serde_json::Value = serde_json::from_slice(&record).expect("JSON");
        let words = labels.as_chunks::<4>().0.iter();
        let words: Vec<u32> = words.map(|word| u32::from_le_bytes(*word)).collect();
        assert!(words.iter().filter(|&&word| word == 49).count() > points / 10);
        for vehicle in record["vehicles"].as_array().expect("vehicles") {
            let on_it = |word: &&u32| vehicle["instance"] == **word >> 16;
            let count = words.iter().filter(on_it).count();
            assert_eq!(vehicle["lidar_points"], count, "{vehicle}");
        }
        let image = |folder: &str| {
            let path = root.path().join(format!("{folder}/{frame:06}.png"));
            image::open(path).expect("a picture").into_luma16()
        };
        let (depth, instance) = (image("depth_2"), image("instance_2"));
        assert_eq!(depth.dimensions(), (1242, 375));
        // What is seen is somewhere; the road before the bonnet is some metres away.
        let mut pixels = depth.pixels().zip(instance.pixels());
        assert!(pixels.all(|(depth, instance)| instance[0] == 0 || depth[0] > 0));
        assert!((2 * 256..30 * 256).contains(&depth[(600, 374)][0]));
    }
}

#[test]
fn pictures_alone_are_the_same_and_need_no_sweep() {
    let root = tempfile::tempdir().expect("a folder");
    let [whole, pictures] = ["whole", "pictures"].map(|name| root.path().join(name));
    write_dataset(&spec(&whole), go_on).expect("a data set");
    let formats = [Format::TuSimple].into();
    let alone = DatasetSpec {
        formats,
        ..spec(&pictures)
    };
    write_dataset(&alone, go_on).expect("a data set");
    let read = |root: &Path, name: &str| std::fs::read(root.join(name)).expect("a file");
    for name in ["image_2/000001.png", "lanes/000001.json"] {
        assert_eq!(read(&whole, name), read(&pictures, name), "{name}");
    }
    assert!(!pictures.join("velodyne").exists());
    let scene = crate::read_scene(&pictures.join("scenes/000001.json")).expect("a record");
    assert!(!scene.vehicles.is_empty());
    assert!(scene.vehicles.iter().all(|of| of.lidar_points == 0));
}
