/* The car: what is soldered and screwed together. Measure yours and change the numbers here. */
#ifndef CONFIG_H
#define CONFIG_H

/* Eight characters; a program configured for another robot refuses to drive this one. */
#define ROBOT_NAME "maxston8"

/* Limits, whatever is asked for. */
#define MAX_SPEED_MM_S 1000
#define MAX_CURVATURE_1_KM 2200
#define ACCELERATION_MM_S2 2000

/* Steering: pulse = NEUTRAL + curvature * US_PER_CURVATURE, the rear wheels counter-steer. */
#define FRONT_NEUTRAL_US 1500
#define REAR_NEUTRAL_US 1500
#define FRONT_US_PER_1_M 200 /* change the sign when a servo turns the wrong way */
#define REAR_US_PER_1_M (-200)

/* Motor controller: pulse = 1500 +- (DEAD_BAND + speed * US_PER_M_S). */
#define MOTOR_NEUTRAL_US 1500
#define MOTOR_DEAD_BAND_US 30
#define MOTOR_US_PER_M_S 200
#define MOTOR_BRAKE_US 1350
#define MOTOR_TAP_US 1465 /* the brake where it may be taken for reverse: just beyond the dead band */
#define BRAKE_MS 300 /* a pulse below neutral after driving forward is the brake ... */
#define PAUSE_MS 120 /* ... and after a pause at neutral it is reverse ... */
#define FORWARD_MS 60 /* ... until it has driven forward for so long */

/* Any pulse, whatever the sums say. */
#define MIN_PULSE_US 1000
#define MAX_PULSE_US 2000

/* Battery: two resistors to the ADC. Below LOW_MV the car drives no faster than LOW_SPEED_MM_S; below EMPTY_MV the wheels
 * stand until it is above LOW_MV again. Either counts when it has lasted LASTS_MS: a motor that starts pulls the voltage
 * down for a moment. Below ABSENT_MV nothing is connected. EMPTY_MV 0: never stop; LOW_SPEED_MM_S MAX_SPEED_MM_S: no limit. */
#define BATTERY_FULL_SCALE_MV 15000
#define BATTERY_LOW_MV 6400
#define BATTERY_LOW_SPEED_MM_S 300
#define BATTERY_EMPTY_MV 6000
#define BATTERY_ABSENT_MV 1000
#define BATTERY_LASTS_MS 2000

/* The wheels stand when no command came for this long, or no heartbeat. */
#define COMMAND_TIMEOUT_MS 200
#define HEARTBEAT_TIMEOUT_MS 150

/* At the NOISE_LIMITth refused frame within NOISE_MS the wheels stand. */
#define NOISE_LIMIT 4
#define NOISE_MS 1000

/* Telemetry also without heartbeats. Well below their 30 ms: else it is often under way when one comes, whose answer
 * then waits. */
#define TELEMETRY_MS 20

#define BAUD 500000UL
#endif
