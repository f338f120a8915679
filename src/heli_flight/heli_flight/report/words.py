# SPDX-License-Identifier: Apache-2.0
"""What the simulation holds and what it leaves out: stands in every report."""

SIMULATED = (
    "Rigid body with six degrees of freedom, attitude as a quaternion, eq. (1) to (5).",
    "Main rotor with inflow and first-order flapping, eq. (6), (7); tail rotor, fuselage, fins.",
    "Yaw-rate gyro, eq. (8); servos of second order with limits of rate and travel; transport "
    "delay of the commands.",
    "Wind: mean over height, MIL-F-8785C Dryden turbulence, discrete gusts.",
    "IMU, magnetometer and barometer with noise and bias; GPS with noise, slow drift and latency.",
    "The loop as it would fly: observer at 100 Hz, attitude law at 100 Hz, position law at 25 Hz.",
)
NOT_SIMULATED = (
    "Rotor speed and engine: the governor is perfect.",
    "Blade dynamics beyond first-order flapping; ground effect; wake on the tail rotor.",
    "Gusts over the rotor's extent; turbulence that decays in time as well as in space; wind that "
    "turns with height. MIL-F-8785C is made for forward flight; in hover it is a convention.",
    "Vibration, scale factors, misalignment and saturation of the IMU; lever arms of the sensors; "
    "GPS outages and multipath; magnetic field of motor currents.",
    "A real flight: the paper's numbers are from flight, all of this is computed.",
)
