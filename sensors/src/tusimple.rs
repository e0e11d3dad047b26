use covista_world::{MARK_COUNT, ROW_ANCHORS};
use serde::{Deserialize, Serialize};

/// u of each mark at each of the [`ROW_ANCHORS`], where it is seen.
pub type MarkPixels = [[Option<f32>; ROW_ANCHORS.len()]; MARK_COUNT];

/// Labels of one image in TuSimple's layout.
#[derive(Serialize)]
struct Record<'a> {
    raw_file: &'a str,
    lanes: [Vec<f64>; MARK_COUNT],
    h_samples: [u32; ROW_ANCHORS.len()],
    run_time: u32,
}

/// TuSimple's place for a row in which a lane is not seen.
const NOT_SEEN: f64 = -2.0;

/// One line of a TuSimple label file, without the line break: for each mark its u in pixels, to a
/// hundredth, at each of the [`ROW_ANCHORS`], -2 where it is not seen.
///
/// # Errors
/// When a pixel is no JSON number.
pub fn tusimple_line(raw_file: &str, pixels: &MarkPixels) -> Result<String, serde_json::Error> {
    let column = |u: &Option<f32>| u.map_or(NOT_SEEN, |u| (f64::from(u) * 100.0).round() / 100.0);
    serde_json::to_string(&Record {
        raw_file,
        lanes: std::array::from_fn(|mark| pixels[mark].iter().map(column).collect()),
        h_samples: ROW_ANCHORS.map(|anchor| anchor.0),
        run_time: 0,
    })
}

/// The marks of a TuSimple line at the [`ROW_ANCHORS`] of a picture in which `place` finds the
/// pixels (u, v) of the labelled one: straight lines between its samples.
///
/// # Errors
/// When the text is no such line or has more lanes than the road has marks.
pub fn read_tusimple_line(
    text: &str,
    place: impl Fn([f64; 2]) -> Option<[f64; 2]>,
) -> Result<MarkPixels, String> {
    let line: Line = serde_json::from_str(text).map_err(|error| error.to_string())?;
    if line.lanes.len() > MARK_COUNT {
        let count = line.lanes.len();
        return Err(format!("{count} lanes, and at most {MARK_COUNT} are known"));
    }
    if let Some(lane) = line
        .lanes
        .iter()
        .find(|lane| lane.len() != line.h_samples.len())
    {
        let (found, rows) = (lane.len(), line.h_samples.len());
        return Err(format!("a lane has {found} places for {rows} h_samples"));
    }
    let mut marks = [[None; ROW_ANCHORS.len()]; MARK_COUNT];
    for (mark, lane) in marks.iter_mut().zip(&line.lanes) {
        let samples = lane.iter().zip(&line.h_samples);
        let points: Vec<_> = samples
            .map(|(&u, &v)| (u >= 0.0).then(|| place([u, v])).flatten())
            .collect();
        for (u, anchor) in mark.iter_mut().zip(&ROW_ANCHORS) {
            *u = column_at(f64::from(anchor.0), &points).map(|u| u as f32);
        }
    }
    Ok(marks)
}

/// The part of a line that is read.
#[derive(Deserialize)]
struct Line {
    lanes: Vec<Vec<f64>>,
    h_samples: Vec<f64>,
}

/// Two rows nearer to each other than this are the same, in pixels.
const SAME_ROW_PX: f64 = 1e-6;

/// Where a lane crosses `row`: at one of its points, or between two neighbours that are both seen.
fn column_at(row: f64, points: &[Option<[f64; 2]>]) -> Option<f64> {
    let at = |&[_, v]: &&[f64; 2]| (v - row).abs() < SAME_ROW_PX;
    if let Some([u, _]) = points.iter().flatten().find(at) {
        return Some(*u);
    }
    points.windows(2).find_map(|pair| {
        let (above, below) = (pair[0]?, pair[1]?);
        let share = (row - above[1]) / (below[1] - above[1]);
        (0.0..=1.0)
            .contains(&share)
            .then(|| above[0] + share * (below[0] - above[0]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_tusimples_json() {
        let mut pixels = [[None; ROW_ANCHORS.len()]; MARK_COUNT];
        pixels[1][27] = Some(512.3456);
        let line = tusimple_line("image_2/000000.png", &pixels).unwrap();
        assert!(!line.contains('\n'));
        let json: serde_json::Value = serde_json::from_str(&line).unwrap();
        assert_eq!(json["raw_file"], "image_2/000000.png");
        assert_eq!(json["run_time"], 0);
        assert_eq!(json["h_samples"].as_array().unwrap().len(), 28);
        assert_eq!(json["h_samples"][27], 370);
        assert_eq!(json["lanes"].as_array().unwrap().len(), 4);
        assert_eq!(json["lanes"][1][27], 512.35);
        assert_eq!(json["lanes"][0][0], -2.0);
    }

    #[test]
    fn a_line_is_read_at_our_rows_whatever_its_own() {
        let mut pixels = [[None; ROW_ANCHORS.len()]; MARK_COUNT];
        for (row, u) in pixels[2].iter_mut().enumerate().skip(10) {
            *u = Some(300.0 + 4.0 * row as f32);
        }
        let line = tusimple_line("image_2/000000.png", &pixels).unwrap();
        assert_eq!(read_tusimple_line(&line, Some).unwrap(), pixels);

        // Labelled in a picture of half the size, at rows 51, 61, ...: u = 150 + 0.8 (row - 51).
        let rows: Vec<f64> = (0..14).map(|i| 51.0 + 10.0 * f64::from(i)).collect();
        let lane: Vec<f64> = rows.iter().map(|row| 150.0 + 0.8 * (row - 51.0)).collect();
        let line = serde_json::json!({"lanes": [lane], "h_samples": rows}).to_string();
        let read = read_tusimple_line(&line, |pixel| Some(pixel.map(|px| 2.0 * px))).unwrap();
        assert_eq!(read[0][0], None);
        let u = read[0][1].unwrap();
        assert!(
            (u - 2.0 * (150.0 + 0.8 * (55.0 - 51.0))).abs() < 1e-3,
            "{u}"
        );

        let torn = r#"{"lanes": [[1, 2]], "h_samples": [100]}"#;
        assert!(
            read_tusimple_line(torn, Some)
                .unwrap_err()
                .contains("2 places")
        );
    }
}
