/// Colours that people with any common colour blindness can tell apart (Okabe and Ito, 2008).
pub const BLACK: Rgb = [20, 20, 20];
pub const WHITE: Rgb = [235, 235, 235];
pub const ORANGE: Rgb = [230, 159, 0];
pub const SKY_BLUE: Rgb = [86, 180, 233];
pub const GREEN: Rgb = [0, 158, 115];
pub const YELLOW: Rgb = [240, 228, 66];
pub const BLUE: Rgb = [0, 114, 178];
pub const VERMILLION: Rgb = [213, 94, 0];
pub const PURPLE: Rgb = [204, 121, 167];
pub const GREY: Rgb = [150, 150, 150];

/// Red, green, blue.
pub type Rgb = [u8; 3];

/// The colour of the `index`-th curve of a diagram.
pub fn series_color(index: usize) -> Rgb {
    const SERIES: [Rgb; 7] = [BLUE, ORANGE, GREEN, PURPLE, SKY_BLUE, VERMILLION, YELLOW];
    SERIES[index % SERIES.len()]
}

/// The colour of a LIDAR point `height_m` above the ground: viridis over 0 to 3 m, in 24 steps.
pub fn height_color(height_m: f32) -> Rgb {
    const VIRIDIS: [[f32; 3]; 5] = [
        [72.0, 40.0, 120.0],
        [62.0, 74.0, 137.0],
        [38.0, 130.0, 142.0],
        [53.0, 183.0, 121.0],
        [253.0, 231.0, 37.0],
    ];
    const STEPS: f32 = 24.0;
    let t = ((height_m / 3.0).clamp(0.0, 1.0) * STEPS).round() / STEPS * 4.0;
    let low = (t as usize).min(3);
    std::array::from_fn(|channel| {
        let (a, b) = (VIRIDIS[low][channel], VIRIDIS[low + 1][channel]);
        (a + (t - low as f32) * (b - a)) as u8
    })
}
