/* The published step of navigation [A fig. 5, 10] in C99 for a microcontroller, without allocation and without files.
 *
 * Two patches and two rows of grey bytes in; speed, curvature, ranges and pose out. All sizes and constants come from
 * params.h, which `python -m ndtorch_robot.onboard` writes for a robot. With ONBOARD_FIXED the work on pixels is done
 * in whole numbers; with ONBOARD_AVOIDANCE_ONLY the rows, the ranges and the map are left out.
 *
 * Units: m, s, radians; x forward, y left, curvature and angles to the left positive. */
#ifndef ONBOARD_H
#define ONBOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "params.h"

#define ONBOARD_PATCH_PIXELS (PATCH_ROWS * PATCH_COLUMNS)

/* Grey 0..1 as a float, or 0..255 in units of 1/256. */
#ifdef ONBOARD_FIXED
typedef uint16_t onboard_grey;
typedef int32_t onboard_motion;
#else
typedef float onboard_grey;
typedef float onboard_motion;
#endif

/* One camera's pixels, which may lie in the frame buffer of the camera: they are read once and not kept. */
typedef struct {
    const uint8_t *patch; /* first pixel of the subfield */
    uint16_t stride;      /* pixels from one line of the subfield to the next */
    const uint8_t *row;   /* the horizon row, ROW_COLUMNS pixels */
} onboard_view;

typedef enum { ONBOARD_CRUISE, ONBOARD_TURN, ONBOARD_SUPPRESSED, ONBOARD_STOPPED } onboard_mode;

typedef struct {
    float range, left_angle, right_angle; /* from the left camera; at both cameras */
    float x, y;                           /* in the body frame */
    bool valid;
} onboard_range;

typedef struct {
    float x, y, heading;
} onboard_pose;

typedef struct {
    float speed, curvature;
    float sides[2]; /* image speed beside the path, left and right, in the units of [A fig. 3] */
    uint8_t mode;   /* onboard_mode */
    onboard_pose pose; /* where the car is now, by dead reckoning */
#ifndef ONBOARD_AVOIDANCE_ONLY
    onboard_range ranges[FEATURES];
#endif
} onboard_output;

/* All that is remembered from frame to frame. Zeros begin with the next frame. */
typedef struct {
    bool begun;
    onboard_grey patches[2][ONBOARD_PATCH_PIXELS]; /* low-passes of the subfields */
#ifndef ONBOARD_AVOIDANCE_ONLY
    onboard_grey rows[2][ROW_COLUMNS]; /* and of the rows */
    onboard_motion motion[ROW_COLUMNS]; /* scratch of one step */
#endif
    float difference; /* right - left, low-passed */
    int32_t age;      /* steps since the last turn began */
    bool stopped;
    float speed, curvature; /* the last command */
    onboard_pose pose;
} onboard_state;

/* One frame of both cameras, left first. */
void onboard_step(onboard_state *state, const onboard_view views[2], onboard_output *output);

#ifndef ONBOARD_AVOIDANCE_ONLY
/* A map of square cells of MAP_CELL m; cells[row * columns + column], row 0 at the bottom. */
typedef struct {
    float left, bottom; /* x and y of its corner */
    uint16_t rows, columns;
    float *cells;
} onboard_map;

/* Adds the certainty of every valid range [A eq. A.6-A.13], per area, to the cells of its beams. */
void onboard_map_add(onboard_map *map, const onboard_output *output);
#endif

#endif
