#include "onboard.h"

#include <math.h>
#include <string.h>

#define COUNT(array) (sizeof(array) / sizeof *(array))

#ifdef ONBOARD_FIXED
/* Grey in units of 1/256 of a level; what is compared with a threshold is scaled to 0..1 once. */
#define GREY_ONE (255.0f * 256.0f)
static onboard_grey grey_of(uint8_t pixel) { return (onboard_grey)(pixel << 8); }

static onboard_grey step_of(onboard_grey difference) {
    /* The share has 15 bits: its product with a difference of 16 bits fits into 32. */
    const uint32_t share = (uint32_t)(HIGH_PASS_SHARE * 32768.0f + 0.5f);
    return (onboard_grey)((difference * share + 16384u) >> 15);
}

static onboard_grey low_pass(onboard_grey low, onboard_grey now) {
    return (onboard_grey)(now > low ? low + step_of((onboard_grey)(now - low)) : low - step_of((onboard_grey)(low - now)));
}

static onboard_motion magnitude(onboard_grey now, onboard_grey low) { return now > low ? now - low : low - now; }
#else
#define GREY_ONE 1.0f
/* Rounded as the mean of three equal colours is. */
static onboard_grey grey_of(uint8_t pixel) { return (float)(3 * pixel) * (1.0f / 765.0f); }

static onboard_grey low_pass(onboard_grey low, onboard_grey now) {
    /* From the nearer end. */
    return HIGH_PASS_SHARE < 0.5f ? low + HIGH_PASS_SHARE * (now - low) : now + (1.0f - HIGH_PASS_SHARE) * (low - now);
}

static onboard_motion magnitude(onboard_grey now, onboard_grey low) { return fabsf(now - low); }
#endif

/* ND-min of one pixel: the magnitude of its high-pass [A fig. 1c]. */
static onboard_motion nd_min(onboard_grey *low, uint8_t pixel, bool begun) {
    onboard_grey now = grey_of(pixel);
    *low = begun ? low_pass(*low, now) : now;
    return magnitude(now, *low);
}

/* The largest ND-min of a subfield. */
static float subfield_motion(onboard_grey *low, const onboard_view *view, bool begun) {
    onboard_motion most = 0;
    for (uint16_t y = 0; y < PATCH_ROWS; y++) {
        const uint8_t *line = view->patch + (uint32_t)y * view->stride;
        for (uint16_t x = 0; x < PATCH_COLUMNS; x++) {
            onboard_motion now = nd_min(low++, line[x], begun);
            if (now > most) most = now;
        }
    }
    return (float)most / GREY_ONE * SPEED_SCALE;
}

/* Dead reckoning along the arc of the last command. */
static void reckon(onboard_state *s) {
    float length = s->speed * TIME_STEP, half = s->curvature * length / 2;
    float chord = half != 0.0f ? length * sinf(half) / half : length;
    float direction = s->pose.heading + half;
    s->pose.x += chord * cosf(direction);
    s->pose.y += chord * sinf(direction);
    s->pose.heading = direction + half;
}

/* The state machine of [A fig. 5]: turn away from the larger side, then do not watch for a time. */
static void avoid(onboard_state *s, float left, float right) {
    float now = right - left;
    if (!s->begun) {
        s->difference = now;
        s->age = START_AGE_STEPS;
    }
    s->difference += SMOOTHING_SHARE * (now - s->difference);
    if (s->age < INT32_MAX) s->age++;
    bool cruising = s->age >= WATCHING_STEPS && !s->stopped;
    bool high = fminf(left, right) > HIGH_THRESHOLD;
    if (cruising && fmaxf(left, right) < LOW_THRESHOLD) {
        s->stopped = true; /* what does not move sees nothing move: for good */
    } else if (cruising && (high || fabsf(s->difference) > TURN_THRESHOLD)) {
        s->curvature = high ? copysignf(TIGHT_CURVATURE, now) : copysignf(NORMAL_CURVATURE, s->difference);
        s->age = 0;
        return;
    }
    if (s->stopped || s->age >= TURN_STEPS) s->curvature = 0;
}

static onboard_mode mode_of(const onboard_state *s) {
    if (s->stopped) return ONBOARD_STOPPED;
    if (s->curvature != 0.0f) return ONBOARD_TURN;
    return s->age < WATCHING_STEPS ? ONBOARD_SUPPRESSED : ONBOARD_CRUISE;
}

#ifndef ONBOARD_AVOIDANCE_ONLY
typedef struct {
    uint16_t column;
    const uint8_t *patch; /* three pixels */
    bool good;
} feature;

/* Squared difference of two patches of three pixels [A eq. A.2], in squared grey levels. */
static int32_t patch_error(const uint8_t *one, const uint8_t *other) {
    int32_t total = 0;
    for (uint8_t k = 0; k < 3; k++) total += (int32_t)(one[k] - other[k]) * (one[k] - other[k]);
    return total;
}

/* The places of a row that move most, more than SPACING apart [A Methods]; the outermost pixels have no patch. */
static void find_features(onboard_motion *motion, const uint8_t *row, feature found[FEATURES]) {
    motion[0] = motion[ROW_COLUMNS - 1] = -1;
    for (uint8_t n = 0; n < FEATURES; n++) {
        int32_t best = 0;
        for (int32_t x = 1; x < ROW_COLUMNS; x++)
            if (motion[x] > motion[best]) best = x;
        found[n] = (feature){(uint16_t)best, row + best - 1, (float)motion[best] >= MIN_MOTION * GREY_ONE};
        int32_t last = best + SPACING < ROW_COLUMNS ? best + SPACING : ROW_COLUMNS - 1;
        for (int32_t x = best > SPACING ? best - SPACING : 0; x <= last; x++) motion[x] = -1;
    }
    for (uint8_t i = 0; i < FEATURES; i++)
        for (uint8_t j = 0; j < FEATURES; j++)
            if (i != j && (float)patch_error(found[i].patch, found[j].patch) < MIN_DIFFERENCE * 65025.0f)
                found[i].good = false;
}

/* The right feature that is most like a left one; FEATURES where there is none. */
static uint8_t partner_of(const feature *left, const feature right[FEATURES], int32_t *error) {
    uint8_t best = FEATURES;
    for (uint8_t j = 0; j < FEATURES; j++) {
        int32_t now = left->good && right[j].good ? patch_error(left->patch, right[j].patch) : INT32_MAX;
        if (now < (best < FEATURES ? *error : INT32_MAX)) {
            *error = now;
            best = j;
        }
    }
    return best;
}

static float angle_of(uint16_t column) {
    float place = (AXIS_COLUMN - (float)column) * ANGLE_FACTOR;
    return EXACT_ANGLES ? atanf(place) : place;
}

/* R = b cos(right) / sin(right - left) [A eq. A.5]. */
static onboard_range triangulate(uint16_t left_column, uint16_t right_column) {
    onboard_range r = {.left_angle = angle_of(left_column), .right_angle = angle_of(right_column)};
    if (!(r.right_angle > r.left_angle)) return (onboard_range){0};
    r.range = BASELINE * cosf(r.right_angle) / sinf(r.right_angle - r.left_angle);
    r.x = CAMERA_FORWARD + r.range * cosf(r.left_angle);
    r.y = BASELINE / 2 + r.range * sinf(r.left_angle);
    r.valid = true;
    return r;
}

/* For every left feature the right one with the least error; then the disparity must be in its window [A Methods]. */
static void match(const feature left[FEATURES], const feature right[FEATURES], onboard_range ranges[FEATURES]) {
    int32_t errors[FEATURES];
    uint8_t partners[FEATURES];
    for (uint8_t i = 0; i < FEATURES; i++) partners[i] = partner_of(&left[i], right, &errors[i]);
    for (uint8_t i = 0; i < FEATURES; i++) {
        uint8_t j = partners[i];
        ranges[i] = (onboard_range){0};
        if (j == FEATURES) continue;
        bool valid = true;
        for (uint8_t k = 0; k < FEATURES; k++) { /* a right feature belongs to the left one that it resembles most */
            int32_t rival = left[k].good ? patch_error(left[k].patch, right[j].patch) : INT32_MAX;
            if (rival < errors[i] || (k < i && rival == errors[i])) valid = false;
        }
        float disparity = (float)left[i].column - (float)right[j].column;
        if (valid && disparity > MIN_DISPARITY && disparity < MAX_DISPARITY)
            ranges[i] = triangulate(left[i].column, right[j].column);
    }
}

static void range_rows(onboard_state *s, const onboard_view views[2], onboard_range ranges[FEATURES]) {
    feature found[2][FEATURES];
    for (uint8_t camera = 0; camera < 2; camera++) {
        for (uint16_t x = 0; x < ROW_COLUMNS; x++)
            s->motion[x] = nd_min(&s->rows[camera][x], views[camera].row[x], s->begun);
        find_features(s->motion, views[camera].row, found[camera]);
    }
    match(found[0], found[1], ranges);
}

/* Places along and across the product of two beams, as `beam_table` of Python. */
static void add_beams(onboard_map *map, const onboard_range *r, float cos_heading, float sin_heading, onboard_pose at) {
    float left_tangent = tanf(r->left_angle), right_tangent = tanf(r->right_angle);
    for (uint16_t i = 0; i < COUNT(beam_along); i++) {
        for (uint16_t j = 0; j < COUNT(beam_across); j++) {
            float one = beam_across[j] - beam_along[i], other = beam_across[j] + beam_along[i];
            float left = (left_tangent + one) / (1 - left_tangent * one);
            float right = (right_tangent + other) / (1 - right_tangent * other);
            float x = BASELINE / fmaxf(right - left, BASELINE / FARTHEST_CROSSING);
            float far = left * left + 1, near = right * right + 1;
            float fall = expf((sqrtf(far) + sqrtf(near)) * x * (-1 / BEAM_REACH));
            float weight = fall * x * x * x * far * near * beam_along_weight[i] * beam_across_weight[j];
            float ahead = x + CAMERA_FORWARD, aside = left * x + BASELINE / 2;
            float column = (at.x + cos_heading * ahead - sin_heading * aside - map->left) / MAP_CELL;
            float row = (at.y + sin_heading * ahead + cos_heading * aside - map->bottom) / MAP_CELL;
            if (column >= 0 && row >= 0 && column < map->columns && row < map->rows)
                map->cells[(uint32_t)row * map->columns + (uint32_t)column] += weight;
        }
    }
}

void onboard_map_add(onboard_map *map, const onboard_output *output) {
    float cos_heading = cosf(output->pose.heading), sin_heading = sinf(output->pose.heading);
    for (uint8_t i = 0; i < FEATURES; i++)
        if (output->ranges[i].valid) add_beams(map, &output->ranges[i], cos_heading, sin_heading, output->pose);
}
#endif

void onboard_step(onboard_state *s, const onboard_view views[2], onboard_output *output) {
    for (uint8_t camera = 0; camera < 2; camera++)
        output->sides[camera] = subfield_motion(s->patches[camera], &views[camera], s->begun);
    reckon(s);
#ifndef ONBOARD_AVOIDANCE_ONLY
    range_rows(s, views, output->ranges);
#endif
    avoid(s, output->sides[0], output->sides[1]);
    s->begun = true;
    s->speed = s->stopped ? 0 : CRUISE_SPEED;
    output->speed = s->speed;
    output->curvature = s->curvature;
    output->mode = mode_of(s);
    output->pose = s->pose;
}
