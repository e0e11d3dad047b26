#!/usr/bin/env python3
"""The front and rear distances of the safety filter against ad-rss, Intel's library of RSS.

    pip install ad-rss
    cargo test --release -p covista-control oracle -- --nocapture

The test prints its distances as CSV and pipes them into this script; without the module `ad_rss`
it is skipped. One line is one distance:

    kind,v_rear,v_front,accel,response,brake_rear,brake_front,distance

`front`: D(v, v_k), the way that closes while the ego vehicle (rear) and its leader (front) brake as
hard as they can, without noise and on a straight road. Only for brake_rear <= brake_front: RSS
compares where the two stand, which is the worst moment then.
`rear`: what the rear barrier keeps towards a follower that accelerates for its reaction time and
brakes then, while the ego vehicle (front) brakes as hard as it can.

Tolerances. The vehicles move by explicit Euler, which drives v Ts / 2 more than the integral until
it stands, and ends with a part of a step (at most b Ts^2 / 8 each). RSS wants a response time: for
`front` it is the step Ts at constant speed, v Ts. So D - RSS lies in
[-(v + v_k) Ts / 2, 0] and the rear distance, which counts one step at the follower's top speed
more than RSS, in RSS + [0, v_top Ts]; both widened by 1 mm, to which the library prints and rounds.
"""

import csv
import sys
import warnings

STEP_S = 0.01
ROUNDING_M = 1.5e-3
SKIPPED = 77


def vehicle(rss, speed, accel, response, brake):
    """An object state of RSS that drives straight on; what is of no account is 1."""
    physics, state = rss.physics, rss.rss.core.RelativeObjectState()
    state.object_type = rss.rss.world.ObjectType.OtherVehicle
    dynamics = state.dynamics
    longitudinal, lateral = dynamics.alpha_lon, dynamics.alpha_lat
    longitudinal.accel_max = physics.Acceleration(accel)
    longitudinal.brake_max = physics.Acceleration(-brake)
    longitudinal.brake_min = physics.Acceleration(-brake)
    longitudinal.brake_min_correct = physics.Acceleration(-brake)
    lateral.accel_max = physics.Acceleration(0.1)
    lateral.brake_min = physics.Acceleration(-0.1)
    dynamics.lateral_fluctuation_margin = physics.Distance(0.0)
    dynamics.response_time = physics.Duration(response)
    dynamics.max_speed_on_acceleration = physics.Speed(100.0)
    dynamics.min_longitudinal_safety_distance = physics.Distance(0.0)
    for name in dir(dynamics.unstructured_settings):
        if not name.startswith("_") and name != "assign":
            value = getattr(dynamics.unstructured_settings, name)
            one = 1 if isinstance(value, int) else type(value)(1.0)
            setattr(dynamics.unstructured_settings, name, one)
    place = state.unstructured_object_state
    place.yaw = place.steering_angle = physics.Angle(0.0)
    place.yaw_rate = physics.AngularVelocity(0.0)
    place.dimension.length = place.dimension.width = physics.Distance(1.0)
    place.center_point.x = place.center_point.y = physics.Distance(0.0)
    place.speed_range.minimum = place.speed_range.maximum = physics.Speed(speed)
    lane = state.structured_object_state
    lane.velocity.speed_lon_min = lane.velocity.speed_lon_max = physics.Speed(speed)
    lane.velocity.speed_lat_min = lane.velocity.speed_lat_max = physics.Speed(0.0)
    lane.distance_to_enter_intersection = physics.Distance(0.0)
    lane.distance_to_leave_intersection = physics.Distance(1e3)
    lane.has_priority, lane.is_in_correct_lane = False, True
    return state


def safe_distance(rss, row):
    """RSS' safe distance between two vehicles in line."""
    found = rss.physics.Distance(0.0)
    front = vehicle(rss, row["v_front"], row["accel"], row["response"], row["brake_front"])
    rear = vehicle(rss, row["v_rear"], row["accel"], row["response"], row["brake_rear"])
    known = rss.rss.structured.calculateSafeLongitudinalDistanceSameDirection(front, rear, found)
    if not known:
        raise SystemExit(f"ad-rss refuses {row}")
    return found.mDistance


def allowed(kind, row):
    """The interval in which our distance less that of RSS may lie, in metres."""
    if kind == "front":
        low, high = -(row["v_rear"] + row["v_front"]) * STEP_S / 2, 0.0
    else:
        low, high = 0.0, (row["v_rear"] + row["accel"] * row["response"]) * STEP_S
    return low - ROUNDING_M, high + ROUNDING_M


def main():
    warnings.simplefilter("ignore")
    try:
        import ad_rss
    except ImportError as error:
        print(f"skipped: no module ad_rss ({error}); pip install ad-rss")
        return SKIPPED
    compared, wrong, farthest = {}, 0, {}
    for line in csv.DictReader(sys.stdin):
        kind = line.pop("kind")
        row = {name: float(value) for name, value in line.items()}
        theirs = safe_distance(ad_rss, row)
        low, high = allowed(kind, row)
        # Both are at least zero, so a difference is cut off there.
        within = max(theirs + low, 0.0) - ROUNDING_M <= row["distance"] <= theirs + high
        if not within:
            wrong += 1
            print(f"{kind} {row}: ad-rss has {theirs}")
        compared[kind] = compared.get(kind, 0) + 1
        farthest[kind] = max(farthest.get(kind, 0.0), abs(row["distance"] - theirs))
    for kind, count in compared.items():
        print(f"{kind}: {count} distances, at most {farthest[kind]:.3f} m apart")
    if not all(compared.get(kind, 0) >= 100 for kind in ("front", "rear")):
        print("too few distances were given")
        return 1
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
