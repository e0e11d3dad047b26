use covista_world::{MARK_COUNT, ROW_ANCHORS};
use serde::Serialize;

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
pub fn tusimple_line(
    raw_file: &str,
    pixels: &[[Option<f32>; ROW_ANCHORS.len()]; MARK_COUNT],
) -> Result<String, serde_json::Error> {
    let column = |u: &Option<f32>| u.map_or(NOT_SEEN, |u| (f64::from(u) * 100.0).round() / 100.0);
    serde_json::to_string(&Record {
        raw_file,
        lanes: std::array::from_fn(|mark| pixels[mark].iter().map(column).collect()),
        h_samples: ROW_ANCHORS.map(|anchor| anchor.0),
        run_time: 0,
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
}
