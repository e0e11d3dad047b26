//! The blueprint: which views there are, where they stand and from where they look.
//!
//! It is written as rerun's own `Blueprint` writes it, message by message, because that type can
//! not yet place the eye of a 3D view.

use covista_world::{FrenetPoint, Road, StationId};
use rerun::external::re_log_types::BlueprintActivationCommand;
use rerun::external::re_sdk_types::blueprint::{archetypes, components};
use rerun::{
    ApplicationId, AsComponents, RecordingStream, RecordingStreamBuilder, RecordingStreamResult,
};

use crate::SceneRecord;
use crate::objects::{BODIES, path_of};
use crate::perception::CAMERA;
use crate::recording::TIMELINE;

/// Sends the layout with the recording, as the application's default and active one.
pub fn send_blueprint(
    recording: &RecordingStream,
    application: ApplicationId,
    scene: &SceneRecord,
) -> RecordingStreamResult<()> {
    let (stream, storage) = RecordingStreamBuilder::new(application)
        .blueprint()
        .memory()?;
    stream.set_time_sequence("blueprint", 0);
    let mut layout = Layout {
        stream: &stream,
        last_id: 0,
    };
    layout.write(scene)?;
    let messages = storage.take();
    if let Some(blueprint_id) = messages.first().map(|message| message.store_id().clone()) {
        recording.send_blueprint(
            messages,
            BlueprintActivationCommand {
                blueprint_id,
                make_active: true,
                make_default: true,
            },
        );
    }
    Ok(())
}

/// A view or a container that is part of the layout.
struct Part {
    path: String,
    id: u64,
}

struct Layout<'a> {
    stream: &'a RecordingStream,
    last_id: u64,
}

impl Layout<'_> {
    fn write(&mut self, scene: &SceneRecord) -> RecordingStreamResult<()> {
        let world = self.world_views(scene)?;
        let camera = self.view(
            "2D",
            "Camera of the chosen CAV",
            CAMERA,
            &["$origin/**"],
            &[],
        )?;
        let action = self.states("Action", "states/action")?;
        let filter = self.states("Safety filter", "states/filter")?;
        let lane = self.states("Lane", "states/lane")?;
        let states = self.container(
            components::ContainerKind::Tabs,
            &[action, filter, lane],
            &[],
        )?;
        let side = self.container(
            components::ContainerKind::Vertical,
            &[camera, states],
            &[2.0, 3.0],
        )?;
        let top = self.container(
            components::ContainerKind::Horizontal,
            &[world, side],
            &[3.0, 2.0],
        )?;
        let bottom = self.curves()?;
        let root = self.container(
            components::ContainerKind::Vertical,
            &[top, bottom],
            &[2.6, 1.0],
        )?;
        self.stream.log(
            "viewport",
            &archetypes::ViewportBlueprint::new()
                .with_root_container(components::RootContainer(uuid_bytes(root.id)))
                .with_auto_layout(false)
                .with_auto_views(false),
        )?;
        self.panels()
    }

    fn world_views(&mut self, scene: &SceneRecord) -> RecordingStreamResult<Part> {
        let corner = self.world_view("World", "world", eye_on_corner(&scene.road))?;
        let focus = scene
            .vehicles
            .iter()
            .find(|vehicle| StationId(vehicle.id) == scene.focus);
        let body = focus.map_or_else(
            || "world".to_owned(),
            |vehicle| path_of(BODIES, &vehicle.label).to_string(),
        );
        let follow = self.world_view(
            "Follow the chosen CAV",
            &body,
            ([-22.0, 0.0, 11.0], [14.0, 0.0, 0.0]),
        )?;
        let text = self.view("TextDocument", "About", "description", &["$origin"], &[])?;
        self.container(
            components::ContainerKind::Tabs,
            &[corner, follow, text],
            &[],
        )
    }

    /// A 3D view in the frame of `origin`, with an eye at one point that looks at another.
    fn world_view(
        &mut self,
        name: &str,
        origin: &str,
        (eye, target): ([f32; 3], [f32; 3]),
    ) -> RecordingStreamResult<Part> {
        self.view(
            "3D",
            name,
            origin,
            &["+ /world/**", &format!("- /{CAMERA}/**")],
            &[
                (
                    "EyeControls3D",
                    &archetypes::EyeControls3D::new()
                        .with_kind(components::Eye3DKind::Orbital)
                        .with_position(eye)
                        .with_look_target(target),
                ),
                ("Background", &background()),
                (
                    "LineGrid3D",
                    &archetypes::LineGrid3D::new().with_visible(false),
                ),
            ],
        )
    }

    fn curves(&mut self) -> RecordingStreamResult<Part> {
        let speed = self.curve("Speed in m/s", "plots/speed")?;
        let acceleration = self.curve("Acceleration in m/s²", "plots/acceleration")?;
        let motion =
            self.container(components::ContainerKind::Tabs, &[speed, acceleration], &[])?;
        let headway = self.curve("Headway in m", "plots/headway")?;
        let barrier = self.curve("Smallest barrier h in m", "plots/h")?;
        self.container(
            components::ContainerKind::Horizontal,
            &[motion, headway, barrier],
            &[1.0, 1.0, 1.0],
        )
    }

    fn curve(&mut self, name: &str, origin: &str) -> RecordingStreamResult<Part> {
        self.view(
            "TimeSeries",
            name,
            origin,
            &["$origin/**"],
            &[(
                "PlotLegend",
                &archetypes::PlotLegend::new().with_corner(components::Corner2D::LeftBottom),
            )],
        )
    }

    fn states(&mut self, name: &str, origin: &str) -> RecordingStreamResult<Part> {
        self.view("StateTimeline", name, origin, &["$origin/**"], &[])
    }

    fn panels(&self) -> RecordingStreamResult<()> {
        let collapsed =
            || archetypes::PanelBlueprint::new().with_state(components::PanelState::Collapsed);
        self.stream.log("blueprint_panel", &collapsed())?;
        self.stream.log("selection_panel", &collapsed())?;
        self.stream.log(
            "time_panel",
            &archetypes::TimePanelBlueprint::new()
                .with_state(components::PanelState::Collapsed)
                .with_timeline(TIMELINE),
        )
    }

    fn view(
        &mut self,
        class: &str,
        name: &str,
        origin: &str,
        contents: &[&str],
        properties: &[(&str, &dyn AsComponents)],
    ) -> RecordingStreamResult<Part> {
        let part = self.part("view");
        let queries = contents
            .iter()
            .map(|query| components::QueryExpression((*query).into()));
        self.stream.log(
            format!("{}/ViewContents", part.path),
            &archetypes::ViewContents::new(queries),
        )?;
        self.stream.log(
            part.path.as_str(),
            &archetypes::ViewBlueprint::new(components::ViewClass(class.into()))
                .with_display_name(name)
                .with_space_origin(origin),
        )?;
        for (property, archetype) in properties {
            self.stream
                .log(format!("{}/{property}", part.path), *archetype)?;
        }
        Ok(part)
    }

    /// `shares` are the relative widths or heights of the children.
    fn container(
        &mut self,
        kind: components::ContainerKind,
        children: &[Part],
        shares: &[f32],
    ) -> RecordingStreamResult<Part> {
        let part = self.part("container");
        let contents = children
            .iter()
            .map(|child| components::IncludedContent(child.path.as_str().into()));
        let blueprint = archetypes::ContainerBlueprint::new(kind).with_contents(contents);
        let blueprint = match kind {
            components::ContainerKind::Horizontal => {
                blueprint.with_col_shares(shares.iter().copied())
            }
            components::ContainerKind::Vertical => {
                blueprint.with_row_shares(shares.iter().copied())
            }
            _ => blueprint,
        };
        self.stream.log(part.path.as_str(), &blueprint)?;
        Ok(part)
    }

    fn part(&mut self, folder: &str) -> Part {
        self.last_id += 1;
        let id = self.last_id;
        Part {
            path: format!("{folder}/00000000-0000-4000-8000-{id:012x}"),
            id,
        }
    }
}

fn background() -> archetypes::Background {
    archetypes::Background::new(components::BackgroundKind::SolidColor)
        .with_color(rerun::Color::from_rgb(22, 24, 28))
}

fn uuid_bytes(id: u64) -> rerun::datatypes::Uuid {
    let bytes = (0x4000_8000_0000_0000_0000 | u128::from(id)).to_be_bytes();
    rerun::datatypes::Uuid { bytes }
}

/// Position and target of an eye that looks from the outside of the sharpest corner, somewhat
/// before it, down into it.
fn eye_on_corner(road: &Road) -> ([f32; 3], [f32; 3]) {
    let length_m = road.length_m();
    let stations: Vec<_> = (0..=200).map(|i| length_m * f64::from(i) / 200.0).collect();
    let sharpest = road.max_abs_curvature(0.0, length_m);
    let corner: Vec<_> = stations
        .into_iter()
        .filter(|&s_m| road.curvature(s_m).abs() >= 0.9 * sharpest)
        .collect();
    let s_m = corner
        .get(corner.len() / 2)
        .copied()
        .unwrap_or(length_m / 2.0);
    let outside = if road.curvature(s_m) > 0.0 { -1.0 } else { 1.0 };
    let target = road.from_frenet(FrenetPoint {
        s_m: s_m - 40.0,
        d_m: 0.0,
    });
    let eye = road.from_frenet(FrenetPoint {
        s_m: s_m - 75.0,
        d_m: outside * 48.0,
    });
    (
        [eye.x as f32, eye.y as f32, 62.0],
        [target.x as f32, target.y as f32, 0.0],
    )
}
