use covista_traffic::Material;
use covista_world::CameraIntrinsics;
use nalgebra::{Isometry3, Vector3};

use crate::caster::{ObjectRef, Solid};
use crate::pixel_rays::PixelRays;
use crate::silhouette::Silhouette;

/// A face whose plane passes closer to the eye than this is seen edge-on.
const NEAREST_FACE_M: f64 = 1e-6;

/// The convex parts of vehicles and scenery in the image.
///
/// A ray enters a convex part through the farthest of the planes that face the eye, and the
/// reciprocal of a plane's depth is affine in (u, v): so a part is drawn row by row between the
/// ends of its silhouette.
pub(crate) struct Solids {
    parts: Vec<Shape>,
    faces: Vec<Face>,
}

/// A part's outline in the image and its run of faces.
struct Shape {
    outline: Silhouette,
    first_face: u32,
    end_face: u32,
}

/// A face that is turned towards the eye.
pub(crate) struct Face {
    /// Reciprocal of the depth: the factors of u, v and 1.
    nearness: [f64; 3],
    pub(crate) normal: Vector3<f32>,
    pub(crate) material: Material,
    pub(crate) object: ObjectRef,
}

/// What a pixel sees of a face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Fragment {
    /// Reciprocal of the depth; zero where there is nothing.
    pub(crate) nearness: f32,
    face: u32,
}

impl Fragment {
    pub(crate) const NOTHING: Self = Self {
        nearness: 0.0,
        face: 0,
    };
}

/// Room for the fragments of one part in a row, nearness and face apart for the vector units.
pub(crate) struct RowBuffer {
    nearness: Vec<f32>,
    faces: Vec<u32>,
}

impl RowBuffer {
    pub(crate) fn new(width: usize) -> Self {
        Self {
            nearness: vec![0.0; width],
            faces: vec![0; width],
        }
    }
}

/// The nearest face behind a pixel and the one behind that.
pub(crate) type Layers = [Fragment; 2];

impl Solids {
    /// The `parts` that the image holds.
    pub(crate) fn new<'p>(
        parts: impl Iterator<Item = Solid<'p>>,
        intrinsics: &CameraIntrinsics,
        world_from_camera: &Isometry3<f64>,
        rays: &PixelRays,
    ) -> Self {
        let camera_from_world = world_from_camera.inverse();
        let mut solids = Self {
            parts: Vec::new(),
            faces: Vec::new(),
        };
        let mut corners = Vec::new();
        for Solid {
            part,
            faces,
            vertices,
        } in parts
        {
            corners.clear();
            corners.extend(
                vertices
                    .iter()
                    .map(|vertex| camera_from_world * vertex.cast::<f64>()),
            );
            let Some(outline) = Silhouette::new(intrinsics, &corners) else {
                continue;
            };
            let first_face = solids.faces.len() as u32;
            let anchor = part.anchor.cast::<f64>();
            solids
                .faces
                .extend(faces.iter().filter_map(|&[x, y, z, offset_m]| {
                    let normal = Vector3::new(x, y, z);
                    let (nearness, gap_m) =
                        rays.nearness_of_plane(&normal.cast(), &anchor, f64::from(offset_m))?;
                    (gap_m < -NEAREST_FACE_M).then_some(Face {
                        nearness,
                        normal,
                        material: part.material,
                        object: part.object,
                    })
                }));
            let end_face = solids.faces.len() as u32;
            // A part that holds the eye has no face towards it, and is looked through.
            if end_face > first_face {
                solids.parts.push(Shape {
                    outline,
                    first_face,
                    end_face,
                });
            }
        }
        solids
    }

    /// The parts that rows from `top` to `bottom` may show.
    pub(crate) fn between(&self, top: f64, bottom: f64) -> Vec<u32> {
        let parts = self.parts.iter().zip(0..);
        let seen = parts.filter(|(part, _)| part.outline.reaches(top, bottom));
        seen.map(|(_, index)| index).collect()
    }

    pub(crate) fn face(&self, fragment: Fragment) -> &Face {
        &self.faces[fragment.face as usize]
    }

    /// Draws those of the `candidates` that the row at `v` shows; `buffer` is as long as the row.
    pub(crate) fn draw(
        &self,
        candidates: &[u32],
        v: f64,
        row: &mut [Layers],
        buffer: &mut RowBuffer,
    ) {
        let last = row.len() as f64 - 1.0;
        for &index in candidates {
            let part = &self.parts[index as usize];
            let Some((from, to)) = part.outline.span(v) else {
                continue;
            };
            let (from, to) = (from.ceil().max(0.0), to.floor().min(last));
            if from > to {
                continue;
            }
            let (first, end) = (from as usize, to as usize + 1);
            let nearness = &mut buffer.nearness[first..end];
            let faces = &mut buffer.faces[first..end];
            self.enter(part, [from, v], nearness, faces);
            let entered = nearness.iter().zip(&*faces);
            for (layers, (&nearness, &face)) in row[first..end].iter_mut().zip(entered) {
                let fragment = Fragment { nearness, face };
                if fragment.nearness > layers[0].nearness {
                    *layers = [fragment, layers[0]];
                } else if fragment.nearness > layers[1].nearness {
                    layers[1] = fragment;
                }
            }
        }
    }

    /// Where the rays of a run of pixels from (u, v) to the right enter the part.
    fn enter(&self, part: &Shape, [u, v]: [f64; 2], nearness: &mut [f32], faces: &mut [u32]) {
        nearness.fill(f32::INFINITY);
        for face in part.first_face..part.end_face {
            let [per_u, per_v, constant] = self.faces[face as usize].nearness;
            let (start, step) = ((per_u * u + per_v * v + constant) as f32, per_u as f32);
            for (column, (known, through)) in (0_i32..).zip(nearness.iter_mut().zip(&mut *faces)) {
                let here = start + step * column as f32;
                let enters = here < *known;
                *known = if enters { here } else { *known };
                *through = if enters { face } else { *through };
            }
        }
    }
}
