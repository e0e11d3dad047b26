use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::KittiError;

/// A file of a frame: its folder and the extensions that it may have.
type Place = (&'static str, &'static [&'static str]);

const CLOUD: Place = ("velodyne", &["bin"]);
const IMAGE: Place = ("image_2", &["png", "jpg"]);
const CALIBRATION: Place = ("calib", &["txt"]);
const LABELS: Place = ("label_2", &["txt"]);
const LANES: Place = ("lanes", &["json"]);
const SCENE: Place = ("scenes", &["json"]);

/// The files of one frame; any may be missing.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct KittiFrame {
    /// Its number, as its files are named: `000008`.
    pub name: String,
    /// `velodyne/000008.bin`.
    pub cloud: Option<PathBuf>,
    /// `image_2/000008.png`, or `.jpg`.
    pub image: Option<PathBuf>,
    /// `calib/000008.txt`.
    pub calibration: Option<PathBuf>,
    /// `label_2/000008.txt`.
    pub labels: Option<PathBuf>,
    /// `lanes/000008.json`, which only our data sets have.
    pub lanes: Option<PathBuf>,
    /// `scenes/000008.json`, which only our data sets have.
    pub scene: Option<PathBuf>,
}

impl KittiFrame {
    /// The frame `name` of a folder in KITTI's layout.
    pub fn named(folder: &Path, name: &str) -> Self {
        let find = |(sub, extensions): Place| {
            extensions
                .iter()
                .map(|extension| folder.join(sub).join(format!("{name}.{extension}")))
                .find(|path| path.is_file())
        };
        Self {
            name: name.to_owned(),
            cloud: find(CLOUD),
            image: find(IMAGE),
            calibration: find(CALIBRATION),
            labels: find(LABELS),
            lanes: find(LANES),
            scene: find(SCENE),
        }
    }

    /// The frame of a single point cloud (`.bin`) or picture, with the files beside it where it
    /// lies in a folder in KITTI's layout.
    ///
    /// # Errors
    /// When there is no such file or it is neither.
    pub fn of_file(path: &Path) -> Result<Self, KittiError> {
        let file = |what: &str| KittiError::Malformed {
            path: path.display().to_string(),
            what: what.to_owned(),
        };
        if !path.is_file() {
            return Err(file("there is no such file"));
        }
        let has_extension = |(_, extensions): Place| {
            let extension = path.extension().and_then(|extension| extension.to_str());
            extension.is_some_and(|extension| extensions.contains(&extension))
        };
        let parent = path.parent().unwrap_or(Path::new(""));
        let is_in = |(sub, _): Place| parent.file_name().is_some_and(|name| name == sub);
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let beside = |place: Place| match parent.parent() {
            Some(folder) if is_in(place) => Self::named(folder, &name),
            _ => Self {
                name: name.clone().into_owned(),
                ..Self::default()
            },
        };
        let path = Some(path.to_owned());
        if has_extension(CLOUD) {
            Ok(Self {
                cloud: path,
                ..beside(CLOUD)
            })
        } else if has_extension(IMAGE) {
            Ok(Self {
                image: path,
                ..beside(IMAGE)
            })
        } else {
            Err(file("a frame is a .bin, a .png or a .jpg"))
        }
    }
}

/// The frames of a folder in KITTI's layout, by name: all that have a cloud or a picture.
///
/// # Errors
/// When there is none.
pub fn kitti_frames(folder: &Path) -> Result<Vec<KittiFrame>, KittiError> {
    let mut names = BTreeSet::new();
    for (sub, extensions) in [CLOUD, IMAGE] {
        let entries = std::fs::read_dir(folder.join(sub)).into_iter().flatten();
        names.extend(entries.filter_map(|entry| {
            let path = entry.ok()?.path();
            let extension = path.extension()?.to_str()?;
            let name = path.file_stem()?.to_str()?.to_owned();
            extensions.contains(&extension).then_some(name)
        }));
    }
    if names.is_empty() {
        return Err(KittiError::NoFrames(folder.display().to_string()));
    }
    let frames = names.iter().map(|name| KittiFrame::named(folder, name));
    Ok(frames.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_found_by_any_of_their_files_and_by_a_single_one() {
        let root = tempfile::tempdir().expect("a folder");
        let root = root.path();
        assert!(matches!(kitti_frames(root), Err(KittiError::NoFrames(_))));
        for file in [
            "velodyne/000001.bin",
            "velodyne/000001.txt",
            "label_2/000001.txt",
            "image_2/000002.jpg",
            "calib/000003.txt",
            "alone.bin",
        ] {
            let path = root.join(file);
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            std::fs::write(path, b"").expect("written");
        }
        let frames = kitti_frames(root).expect("frames");
        let names: Vec<&str> = frames.iter().map(|frame| frame.name.as_str()).collect();
        assert_eq!(names, ["000001", "000002"]);
        assert!(frames[0].labels.is_some() && frames[0].image.is_none());
        assert!(frames[1].image.is_some() && frames[1].cloud.is_none());

        let one = |name: &str| KittiFrame::of_file(&root.join(name));
        assert_eq!(one("velodyne/000001.bin").expect("a frame"), frames[0]);
        let alone = one("alone.bin").expect("a frame");
        assert!(alone.cloud.is_some() && alone.labels.is_none());
        assert!(one("calib/000003.txt").is_err() && one("none.bin").is_err());
    }
}
