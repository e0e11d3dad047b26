use covista_world::Se2Pose;
use nalgebra::Point3;

/// What a surface is made of: its colour for the camera and its reflectance for the LIDAR.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Material {
    /// Coated metal of a vehicle's body.
    CarPaint([u8; 3]),
    /// Windows: dark to the camera, mostly transparent to the LIDAR.
    Glass,
    /// Tyres.
    Rubber,
    /// Tail lamps and licence plates: retroreflective.
    Reflector([u8; 3]),
    /// Bare metal: guard rails, poles.
    Metal,
    /// Walls and barriers of concrete.
    Concrete,
    /// Buildings, with their colour.
    Plaster([u8; 3]),
    /// Trees and hedges.
    Foliage,
    /// Clothes and skin of people.
    Cloth([u8; 3]),
}

/// A convex part of a body: the hull of its vertices, in the body's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct ConvexPart {
    /// Vertices in metres.
    pub vertices: Vec<Point3<f64>>,
    /// Its surface.
    pub material: Material,
}

impl ConvexPart {
    /// The part moved from the frame of `pose` to the one `pose` is given in, and up by `rise_m`.
    pub fn at(mut self, pose: Se2Pose, rise_m: f64) -> Self {
        for vertex in &mut self.vertices {
            let ground = pose.transform(vertex.xy().coords);
            *vertex = Point3::new(ground.x, ground.y, vertex.z + rise_m);
        }
        self
    }
}

/// A body of several convex parts.
///
/// A vehicle's frame is the vehicle frame of `covista_world` (origin on the ground below the rear
/// axle, x forward, y left, z up); scenery is given in the world frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Body {
    /// The parts, which may overlap.
    pub parts: Vec<ConvexPart>,
}

impl Body {
    /// The body moved from the frame of `pose` to the one `pose` is given in, and up by `rise_m`.
    pub fn at(self, pose: Se2Pose, rise_m: f64) -> Self {
        let parts = self.parts.into_iter();
        Self {
            parts: parts.map(|part| part.at(pose, rise_m)).collect(),
        }
    }
}
