//! The folder of a data set: which frames are finished, and the files that list them.
//!
//! A frame is finished when its record `scenes/000007.json` is there: it is written last, and
//! every file gets its place whole. So the folder is a valid data set whenever a process ends.

use std::collections::BTreeMap;
use std::fs::{self, File, TryLockError};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use serde::Deserialize;
use sha2::{Digest, Sha256};

use super::DatasetSpec;
use super::error::{DatasetError, io_error};
use super::frame::{FrameFile, LANES_FOLDER, RECORD_FOLDER, folders};
use super::manifest::Manifest;
use crate::kitti::KittiFrame;
use crate::mcap::write_mcap;

const MANIFEST_FILE: &str = "manifest.json";
/// TuSimple's file of all frames.
const LANES_FILE: &str = "label_data.json";
const MCAP_FILE: &str = "frames.mcap";
/// Where files grow, and the lock.
const WORK_FOLDER: &str = ".partial";

pub(super) struct Folder<'a> {
    spec: &'a DatasetSpec,
    empty: Manifest,
    /// Held while this process writes.
    _lock: File,
}

/// The part of a frame's record that the folder reads.
#[derive(Deserialize)]
struct Record {
    files: BTreeMap<String, String>,
}

impl<'a> Folder<'a> {
    /// Makes the folders, or makes sure that they hold frames of this data set and that nobody
    /// else writes there.
    pub(super) fn claim(spec: &'a DatasetSpec) -> Result<Self, DatasetError> {
        let root = &spec.out;
        let empty = Manifest::new(spec);
        refuse_foreign(root, &empty)?;
        let work = root.join(WORK_FOLDER);
        fs::create_dir_all(&work).map_err(io_error(&work))?;
        let lock = lock(root, &work.join("lock"))?;
        let folder = Self {
            spec,
            empty,
            _lock: lock,
        };
        for name in folders(spec) {
            let path = root.join(name);
            fs::create_dir_all(&path).map_err(io_error(&path))?;
        }
        if !root.join(MANIFEST_FILE).exists() {
            folder.write_manifest(&folder.empty)?;
        }
        Ok(folder)
    }

    /// Whether the frame's record and all files that it names are there.
    pub(super) fn has(&self, frame: u64) -> bool {
        self.record(frame).is_some_and(|(record, _)| {
            let mut files = record.files.keys();
            files.all(|file| self.spec.out.join(file).is_file())
        })
    }

    /// Writes a frame's files, its record last, or none of them.
    pub(super) fn write_frame(&self, files: &[FrameFile]) -> Result<(), DatasetError> {
        let written = files
            .iter()
            .try_for_each(|file| self.write_whole(&file.path, |to| to.write_all(&file.content)));
        if written.is_err() {
            for file in files {
                // Told already why; on a full disk this makes room for the lists.
                fs::remove_file(self.spec.out.join(&file.path)).ok();
            }
        }
        written
    }

    /// Writes the files that list all finished frames, whoever finished them.
    pub(super) fn list_finished(&self) -> Result<Manifest, DatasetError> {
        let frames = self.finished_frames()?;
        let mut manifest = self.empty.clone();
        for &frame in &frames {
            if let Some((record, hash)) = self.record(frame) {
                manifest.files.extend(record.files);
                manifest.files.insert(record_path(frame), hash);
                manifest.frames += 1;
            }
        }
        if self.spec.has_kitti() {
            let split = format!("ImageSets/{}.txt", self.spec.split.name());
            self.write_whole(&split, |to| {
                frames
                    .iter()
                    .try_for_each(|frame| writeln!(to, "{frame:06}"))
            })?;
        }
        if self.spec.has_tusimple() {
            self.write_whole(LANES_FILE, |to| {
                frames.iter().try_for_each(|frame| {
                    let line = format!("{LANES_FOLDER}/{frame:06}.json");
                    std::io::copy(&mut File::open(self.spec.out.join(line))?, to).map(drop)
                })
            })?;
        }
        self.write_manifest(&manifest)?;
        Ok(manifest)
    }

    /// Writes all finished frames as MCAP.
    pub(super) fn write_mcap(&self) -> Result<(), DatasetError> {
        let frames: Vec<KittiFrame> = self
            .finished_frames()?
            .iter()
            .map(|frame| KittiFrame::named(&self.spec.out, &format!("{frame:06}")))
            .collect();
        let part = self.part(MCAP_FILE);
        write_mcap(&frames, &part).inspect_err(|_| {
            fs::remove_file(&part).ok();
        })?;
        self.put(&part, MCAP_FILE)
    }

    fn finished_frames(&self) -> Result<Vec<u64>, DatasetError> {
        let records = self.spec.out.join(RECORD_FOLDER);
        let mut frames: Vec<u64> = fs::read_dir(&records)
            .map_err(io_error(&records))?
            .filter_map(|entry| entry.ok()?.path().file_stem()?.to_str()?.parse().ok())
            .filter(|&frame| self.has(frame))
            .collect();
        frames.sort_unstable();
        Ok(frames)
    }

    /// A finished frame's record and its hash.
    fn record(&self, frame: u64) -> Option<(Record, String)> {
        let bytes = fs::read(self.spec.out.join(record_path(frame))).ok()?;
        let record = serde_json::from_slice(&bytes).ok()?;
        Some((record, sha256_hex(&bytes)))
    }

    fn write_manifest(&self, manifest: &Manifest) -> Result<(), DatasetError> {
        self.write_whole(MANIFEST_FILE, |to| {
            serde_json::to_writer_pretty(&mut *to, manifest)?;
            writeln!(to)
        })
    }

    /// Writes a file so that it is either whole or not there.
    fn write_whole(
        &self,
        name: &str,
        write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
    ) -> Result<(), DatasetError> {
        let part = self.part(name);
        let attempt = || {
            let mut file = BufWriter::new(File::create(&part)?);
            write(&mut file)?;
            file.flush()
        };
        attempt()
            .inspect_err(|_| {
                fs::remove_file(&part).ok();
            })
            .map_err(io_error(&self.spec.out.join(name)))?;
        self.put(&part, name)
    }

    fn part(&self, name: &str) -> PathBuf {
        let flat = name.replace('/', "-");
        self.spec.out.join(WORK_FOLDER).join(flat)
    }

    fn put(&self, part: &Path, name: &str) -> Result<(), DatasetError> {
        let path = self.spec.out.join(name);
        fs::rename(part, &path).map_err(io_error(&path))
    }
}

impl Drop for Folder<'_> {
    fn drop(&mut self) {
        // What is left there is no part of the data set; nobody is left to be told of a failure.
        fs::remove_dir_all(self.spec.out.join(WORK_FOLDER)).ok();
    }
}

pub(super) fn record_path(frame: u64) -> String {
    format!("{RECORD_FOLDER}/{frame:06}.json")
}

pub(super) fn sha256_hex(bytes: &[u8]) -> String {
    format!("{:x}", Sha256::digest(bytes))
}

/// Refuses a folder with another data set, or with files that only look like one of ours.
fn refuse_foreign(root: &Path, own: &Manifest) -> Result<(), DatasetError> {
    let difference = match fs::read_to_string(root.join(MANIFEST_FILE)) {
        Ok(text) => own.difference(&text),
        Err(_) => {
            let names = ["velodyne", "image_2", "calib", "label_2", LANES_FOLDER];
            let is_filled = |name| {
                fs::read_dir(root.join(name)).is_ok_and(|mut entries| entries.next().is_some())
            };
            names
                .into_iter()
                .any(is_filled)
                .then_some("frames that this program has not written")
        }
    };
    match difference {
        None => Ok(()),
        Some(what) => Err(DatasetError::Foreign {
            path: root.display().to_string(),
            what,
        }),
    }
}

/// Takes the lock, which the system gives back however this process ends.
fn lock(root: &Path, path: &Path) -> Result<File, DatasetError> {
    let file = File::create(path).map_err(io_error(path))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(DatasetError::Busy {
            path: root.display().to_string(),
        }),
        // A file system without locks; there two processes must not share a folder.
        Err(TryLockError::Error(error)) if error.kind() == std::io::ErrorKind::Unsupported => {
            Ok(file)
        }
        Err(TryLockError::Error(error)) => Err(io_error(path)(error)),
    }
}
