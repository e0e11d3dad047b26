//! Frames of a folder in KITTI's layout as one MCAP file of ROS 2 messages.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use ::mcap::records::MessageHeader;
use ::mcap::{WriteOptions, Writer};

use crate::kitti::{KittiError, KittiFrame, read_calibration, read_cloud, read_image, read_labels};
use crate::ros2::{
    CAMERA_INFO, COMPRESSED_IMAGE, MARKERS, POINT_CLOUD, Schema, TRANSFORMS, camera_info,
    compressed_image, markers, mounting, point_cloud,
};

/// The frames are scenes of their own; in the file they are a tenth of a second apart.
const PERIOD_NS: u64 = 100_000_000;

/// Why frames can't be written as MCAP.
#[derive(Debug, thiserror::Error)]
pub enum McapError {
    /// A frame lacks a file or has an unusable one.
    #[error(transparent)]
    Kitti(#[from] KittiError),
    /// The file can't be written.
    #[error("{path}: {source}")]
    Write {
        /// The file.
        path: String,
        /// Why.
        source: ::mcap::McapError,
    },
}

/// Writes `frames` to `path`: the cloud, the picture and its camera, where the sensors sit, and
/// the labelled boxes in the LIDAR frame.
///
/// # Errors
/// When a file of a frame is missing or unusable or `path` can't be written.
pub fn write_mcap(frames: &[KittiFrame], path: &Path) -> Result<(), McapError> {
    let mut file = Messages::create(path)?;
    for (index, frame) in frames.iter().enumerate() {
        let time_ns = index as u64 * PERIOD_NS;
        let calibration = read_calibration(needed(frame, &frame.calibration, "calib")?)?;
        let cloud_path = needed(frame, &frame.cloud, "velodyne")?;
        let image_path = needed(frame, &frame.image, "image_2")?;
        let cloud = crate::kitti::cloud_bytes(&read_cloud(cloud_path)?);
        let image = read_image(image_path)?;
        let image_bytes = std::fs::read(image_path).map_err(crate::kitti::io_error(image_path))?;
        let labels = read_labels(needed(frame, &frame.labels, "label_2")?)?;
        let extension = image_path.extension().unwrap_or_default();
        let format = if extension == "png" { "png" } else { "jpeg" };
        file.write(0, time_ns, &point_cloud(time_ns, &cloud))?;
        file.write(1, time_ns, &compressed_image(time_ns, format, &image_bytes))?;
        file.write(2, time_ns, &camera_info(time_ns, &calibration, &image))?;
        file.write(3, time_ns, &mounting(time_ns, &calibration))?;
        file.write(4, time_ns, &markers(time_ns, &labels, &calibration))?;
    }
    file.finish()
}

const CHANNELS: [(&str, Schema); 5] = [
    ("/lidar/points", POINT_CLOUD),
    ("/camera/image/compressed", COMPRESSED_IMAGE),
    ("/camera/camera_info", CAMERA_INFO),
    ("/tf_static", TRANSFORMS),
    ("/objects", MARKERS),
];

/// An MCAP file with [`CHANNELS`].
struct Messages {
    path: String,
    writer: Writer<BufWriter<File>>,
    channel_ids: Vec<u16>,
    sequence: u32,
}

impl Messages {
    fn create(path: &Path) -> Result<Self, McapError> {
        let path_text = path.display().to_string();
        let attempt = || -> ::mcap::McapResult<_> {
            let options = WriteOptions::new().compression(None).profile("ros2");
            let mut writer = options.create(BufWriter::new(File::create(path)?))?;
            let channel_ids = CHANNELS.iter().map(|(topic, schema)| {
                let schema_id =
                    writer.add_schema(schema.name, "ros2msg", schema.definition.as_bytes())?;
                writer.add_channel(schema_id, topic, "cdr", &BTreeMap::new())
            });
            let channel_ids = channel_ids.collect::<Result<_, _>>()?;
            Ok((writer, channel_ids))
        };
        let (writer, channel_ids) = attempt().map_err(write_error(&path_text))?;
        Ok(Self {
            path: path_text,
            writer,
            channel_ids,
            sequence: 0,
        })
    }

    fn write(&mut self, channel: usize, time_ns: u64, message: &[u8]) -> Result<(), McapError> {
        let header = MessageHeader {
            channel_id: self.channel_ids[channel],
            sequence: self.sequence,
            log_time: time_ns,
            publish_time: time_ns,
        };
        self.sequence += 1;
        self.writer
            .write_to_known_channel(&header, message)
            .map_err(write_error(&self.path))
    }

    fn finish(mut self) -> Result<(), McapError> {
        self.writer
            .finish()
            .map(drop)
            .map_err(write_error(&self.path))
    }
}

fn write_error(path: &str) -> impl Fn(::mcap::McapError) -> McapError {
    let path = path.to_owned();
    move |source| McapError::Write {
        path: path.clone(),
        source,
    }
}

fn needed<'a>(
    frame: &KittiFrame,
    file: &'a Option<PathBuf>,
    folder: &str,
) -> Result<&'a Path, KittiError> {
    file.as_deref().ok_or_else(|| KittiError::Malformed {
        path: format!("{folder}/{}", frame.name),
        what: "the frame lacks this file".to_owned(),
    })
}
