use super::settings::Bonnet;
use crate::appearance::Rgb;
use crate::tile::Tile;

/// A bonnet over a picture of a certain size.
pub(super) struct Overlay {
    top_px: f32,
    /// Fall of the rim at a distance of one from the middle, half a picture's width being one.
    fall_px: f32,
    middle_px: f32,
    half_width_px: f32,
    height_px: f32,
    color: Rgb,
    gloss: f32,
}

impl Overlay {
    pub(super) fn new(bonnet: &Bonnet, width_px: usize, height_px: usize) -> Self {
        let (width, height) = (width_px as f32, height_px as f32);
        let covered_px = height * bonnet.height.clamp(0.0, 0.5) as f32;
        Self {
            top_px: height - covered_px,
            fall_px: covered_px * bonnet.arch.clamp(-1.0, 1.0) as f32,
            middle_px: width * bonnet.middle.clamp(0.0, 1.0) as f32,
            half_width_px: (0.5 * width).max(1.0),
            height_px: covered_px.max(1.0),
            color: Rgb::from(bonnet.color.map(|share| share.clamp(0.0, 1.0) as f32)),
            gloss: bonnet.gloss.clamp(0.0, 1.0) as f32,
        }
    }

    /// First row that the bonnet can reach.
    pub(super) fn first_row(&self) -> usize {
        (self.top_px + self.fall_px.min(0.0) - 2.0).max(0.0) as usize
    }

    /// The exposure at a pixel with the bonnet before it.
    pub(super) fn cover(&self, behind: Rgb, row: usize, column: usize) -> Rgb {
        let x = (column as f32 - self.middle_px) / self.half_width_px;
        let (u, v) = (column as f32, row as f32);
        let ripple = Tile::shared().at(0xB0, u, 0.0, 40.0, 1.0);
        let below_px = v - (self.top_px + self.fall_px * x * x + 0.6 * ripple);
        let share = (0.5 + 0.6 * below_px).clamp(0.0, 1.0);
        if share <= 0.0 {
            return behind;
        }
        // Along the rim one looks flat over the bonnet: there it mirrors the sky.
        let rim = (-3.0 * below_px.max(0.0) / self.height_px).exp();
        let specks = 1.0 + 0.10 * Tile::shared().at(0xB1, 0.3 * u, v, 1.5, 1.0);
        let sky = Rgb::new(0.30, 0.42, 0.60) * (self.gloss * rim * (1.0 - 0.4 * x * x));
        behind.lerp(&((self.color + sky) * specks), share)
    }
}
