// The kernels of a step of the flow (`docs/decisions/0077-flow-on-a-gpu.md`), one thread for each cell, face or row.
//
// NVRTC compiles this file for a GPU when a program starts. A C compiler compiles it for the tests, which call a kernel for one thread after the other.
// All members of arguments are 8 bytes long, so that a list of 64-bit words is the structure. Arrays of velocities have two layers of ghosts around the
// cells and are x fastest; arrays of pressures have no ghosts. Sums have a fixed order: a run repeats bit by bit.

typedef long long integer;

#ifdef __CUDACC__
#define KERNEL(name) extern "C" __global__ void name(const struct name##_arguments a)
#define THREAD integer thread = (integer)blockIdx.x * blockDim.x + threadIdx.x; if (thread >= a.threads) return;
#define FUNCTION __device__ static inline
#define MATH(name) name
#else
static _Thread_local integer current;
#define KERNEL(name) \
    static void name##_thread(const struct name##_arguments a); \
    int name(const integer *words, integer count, integer threads) { \
        const struct name##_arguments *a = (const struct name##_arguments *)words; \
        if (count * (integer)sizeof(integer) != (integer)sizeof(*a)) return 1; \
        for (current = 0; current < threads; current++) name##_thread(*a); \
        return 0; \
    } \
    static void name##_thread(const struct name##_arguments a)
#define THREAD integer thread = current; if (thread >= a.threads) return;
#define FUNCTION static inline
#define MATH(name) __builtin_##name
#endif

// Numbers of cells, and distances of neighbours along y and z in an array with ghosts.
struct grid {
    integer nx, ny, nz, sy, sz;
};

struct cell {
    integer i[3];
    integer at;
};

FUNCTION integer at_cell(struct grid g, integer i, integer j, integer k) {
    return (i + 2) + (j + 2) * g.sy + (k + 2) * g.sz;
}

// Grids have fewer than 2^32 cells.
FUNCTION struct cell cell_of(struct grid g, integer thread) {
    struct cell c;
    const unsigned index = (unsigned)thread, nx = (unsigned)g.nx, ny = (unsigned)g.ny;
    const unsigned row = index / nx, plane = row / ny;
    c.i[0] = index - row * nx;
    c.i[1] = row - plane * ny;
    c.i[2] = plane;
    c.at = at_cell(g, c.i[0], c.i[1], c.i[2]);
    return c;
}

FUNCTION integer stride(struct grid g, int d) {
    return d == 0 ? 1 : d == 1 ? g.sy : g.sz;
}

FUNCTION integer cells_along(struct grid g, int d) {
    return d == 0 ? g.nx : d == 1 ? g.ny : g.nz;
}

// ---- momentum (momentum.rs)

// Inverse distance of the values next to each flux of one component along each axis, and inverse width of its volumes; shares of the lower and upper cell of its
// volumes along the component.
struct lines {
    const double *distance[3], *width[3], *shares;
};

FUNCTION double flux(double a, double b, double c, double d, double v, double share, double k) {
    double central = (7.0 * (b + c) - (a + d)) * (1.0 / 12.0);
    return v * central + (share * MATH(fabs)(v)) * ((d - a) - 3.0 * (c - b)) - k * (c - b);
}

struct rates_arguments {
    integer threads;
    struct grid g;
    const double *u[3];
    double *rates;
    // Rates of the undisturbed air in each plane.
    const double *undisturbed;
    integer component;
    struct lines lines;
    double frame[3];
    // Upwind share over 12, kinematic viscosity.
    double share, viscosity;
    // Whether the low and the high end of each axis is an outflow.
    integer low[3], high[3];
};

// Divergence of the fluxes of component `own` along d, both known to the compiler.
FUNCTION double convection(const struct rates_arguments *a, const struct cell *c, const int own, const int d) {
    const integer across = stride(a->g, own), s = stride(a->g, d), n = cells_along(a->g, d);
    const double *u = a->u[own], *through = a->u[d];
    double f[2];
    for (int side = 0; side < 2; side++) {
        // The flux is between the values below and at p.
        const integer p = c->at + side * s, m = c->i[d] + side;
        const double below = u[p - s], value = u[p];
        double v;
        if (d == own) {
            v = 0.5 * (below + value) - a->frame[d];
            if (m == 1 && a->low[d]) v = MATH(fmin)(v, 0.0);
            if (m == n && a->high[d]) v = MATH(fmax)(v, 0.0);
        } else {
            const double *shares = a->lines.shares + 2 * c->i[own];
            v = shares[0] * through[p - across] + shares[1] * through[p] - a->frame[d];
            if (m == 0 && a->low[d]) v = MATH(fmin)(v, 0.0);
            if (m == n && a->high[d]) v = MATH(fmax)(v, 0.0);
        }
        f[side] = flux(u[p - 2 * s], below, value, u[p + s], v, a->share, a->viscosity * a->lines.distance[d][m]);
    }
    return (f[1] - f[0]) * a->lines.width[d][c->i[d]];
}

FUNCTION double rate_of(const struct rates_arguments *a, const struct cell *c, const int own) {
    return -a->undisturbed[c->i[2]] - convection(a, c, own, 0) - convection(a, c, own, 1) - convection(a, c, own, 2);
}

KERNEL(rates) {
    THREAD
    const struct cell c = cell_of(a.g, thread);
    const integer own = a.component;
    a.rates[c.at] = own == 0 ? rate_of(&a, &c, 0) : own == 1 ? rate_of(&a, &c, 1) : rate_of(&a, &c, 2);
}

struct extrapolate_arguments {
    integer threads;
    struct grid g;
    double *predicted;
    const double *velocity, *rates, *before, *change;
    double now, back;
};

KERNEL(extrapolate) {
    THREAD
    struct cell c = cell_of(a.g, thread);
    a.predicted[c.at] = a.velocity[c.at] + (a.now * a.rates[c.at] - a.back * a.before[c.at]) + a.change[c.i[2]];
}

// ---- free edges and friction (free_edges.rs, friction.rs)

// Of each target: component and position, and the fluxes that change it, with their sign.
struct edges_arguments {
    integer threads;
    const double *u[3];
    double *rates[3];
    const unsigned *target_component, *target, *offsets;
    // Component and axis of the flux, position of its upper value; what it lacks of its upwind share over 12 and the spacing, with the sign of the target.
    const unsigned *component, *axis, *upper;
    const double *factor;
    integer strides[3];
    double frame[3];
};

KERNEL(edges) {
    THREAD
    double sum = 0.0;
    for (unsigned e = a.offsets[thread]; e < a.offsets[thread + 1]; e++) {
        const unsigned c = a.component[e], d = a.axis[e];
        const integer upper = a.upper[e], along = a.strides[d], across = a.strides[c], lower = upper - along;
        const double *u = a.u[c];
        const double v = c == d ? u[lower] + u[upper] : a.u[d][upper - across] + a.u[d][upper];
        const double third = u[upper + along] - u[lower - along] - 3.0 * (u[upper] - u[lower]);
        sum += a.factor[e] * MATH(fabs)(0.5 * v - a.frame[d]) * third;
    }
    a.rates[a.target_component[thread]][a.target[thread]] += sum;
}

// Of each target: the neighbours from which the surface separates it.
struct interrupt_arguments {
    integer threads;
    const double *u[3];
    double *rates[3];
    const unsigned *target_component, *target, *offsets, *other;
    double factor;
};

KERNEL(interrupt) {
    THREAD
    const unsigned c = a.target_component[thread], at = a.target[thread];
    double sum = 0.0;
    for (unsigned e = a.offsets[thread]; e < a.offsets[thread + 1]; e++) sum += a.u[c][a.other[e]] - a.u[c][at];
    a.rates[c][at] -= a.factor * sum;
}

struct wall_arguments {
    integer threads;
    double *u[3];
    const double *start[3];
    const unsigned *target_component, *target, *offsets;
    const double *distance, *first, *last;
    double *force;
    const double *rate;
    // Velocity of each value afterwards.
    double *predicted;
    double factor, mass_over_dt, dt;
};

KERNEL(wall) {
    THREAD
    const unsigned c = a.target_component[thread], at = a.target[thread];
    const unsigned begin = a.offsets[thread], end = a.offsets[thread + 1];
    double *u = &a.u[c][at];
    const double start = a.start[c][at];
    double z = 0.0, first = 0.0, last = 0.0, lost = 0.0;
    for (unsigned s = begin; s < end; s++) z += a.factor / a.distance[s];
    a.predicted[thread] = *u;
    for (unsigned s = begin; s < end; s++) a.force[s] = 0.0;
    if (z == 0.0) return;
    for (unsigned s = begin; s < end; s++) first += a.factor / a.distance[s] * a.first[s];
    for (unsigned s = begin; s < end; s++) last += a.factor / a.distance[s] * a.last[s];
    first = first / z;
    last = last / z;
    double change = *u + a.dt * a.rate[thread] - start;
    change = change - (last - first);
    const double slip = ((1.0 + 0.5 * z) * (start - first) + 0.5 * (1.0 + z) * change) / (1.0 + z + 0.5 * z * z);
    for (unsigned s = begin; s < end; s++) {
        double others = 0.0;
        for (unsigned o = begin; o < end; o++)
            others += a.factor / a.distance[o] * (0.5 * (a.first[o] + a.last[o]) - 0.5 * (a.first[s] + a.last[s]));
        const double own = a.factor / a.distance[s] * (slip + others / z);
        a.force[s] = a.mass_over_dt * own;
        lost += own;
    }
    *u -= lost;
    a.predicted[thread] = *u;
}

struct wall_rates_arguments {
    integer threads;
    struct grid g;
    const double *u[3];
    const unsigned *target_component, *target;
    const double *predicted, *p;
    // Inverse distances of the centres across each face.
    const double *inverse[3];
    double *rate;
    double dt;
};

KERNEL(wall_rates) {
    THREAD
    const unsigned c = a.target_component[thread], at = a.target[thread];
    const integer k = at / a.g.sz - 2, j = at % a.g.sz / a.g.sy - 2, i = at % a.g.sy - 2;
    const integer upper = (k * a.g.ny + j) * a.g.nx + i, lower = upper - (c == 0 ? 1 : c == 1 ? a.g.nx : a.g.nx * a.g.ny);
    const double gradient = (a.p[upper] - a.p[lower]) * a.inverse[c][c == 0 ? i : c == 1 ? j : k];
    a.rate[thread] = (a.u[c][at] - a.predicted[thread] - gradient) / a.dt;
}

// ---- ghosts (grid.rs)

struct ghosts_arguments {
    integer threads;
    struct grid g;
    double *u[3];
    // The far field of each component in each plane, from the lowest ghost on.
    const double *far[3];
    // Axis, and its ends: 0 the far field, 1 slip, 2 outflow, 3 periodic.
    integer axis, low, high;
};

KERNEL(ghosts) {
    THREAD
    const int d = (int)a.axis, first = (d + 1) % 3, second = (d + 2) % 3;
    const integer n = cells_along(a.g, d), s = stride(a.g, d);
    const integer extent = cells_along(a.g, first) + 4, rest = cells_along(a.g, second) + 4;
    const int c = (int)(thread / (extent * rest));
    const integer q = thread / extent % rest, p = thread % extent;
    double *u = a.u[c] + p * stride(a.g, first) + q * stride(a.g, second) + 2 * s;
    const double *far = a.far[c];
    const integer plane = first == 2 ? p : q;
#define FAR(i) (far[d == 2 ? (i) + 2 : plane])
    if (a.low == 3) {
        for (integer layer = 1; layer <= 2; layer++) {
            u[-layer * s] = u[(n - layer) * s];
            u[(n + layer - 1) * s] = u[(layer - 1) * s];
        }
        return;
    }
    const int normal = c == d;
    const integer own = normal ? 0 : -1;
    if (normal && a.low != 2) u[0] = FAR(0);
    for (integer layer = 1; layer <= 2; layer++) {
        const integer to = -layer;
        double value;
        if (a.low == 0) value = FAR(to);
        else if (a.low == 1 && normal) value = (FAR(to) + FAR(layer)) - u[layer * s];
        else {
            const integer from = a.low == 1 ? layer - 1 : own + 1;
            value = u[from * s] + (FAR(to) - FAR(from));
        }
        u[to * s] = value;
    }
    if (normal && a.high != 2) u[n * s] = FAR(n);
    for (integer layer = normal; layer < 2; layer++) {
        const integer to = n + layer;
        double value;
        if (a.high == 0) value = FAR(to);
        else if (a.high == 1 && normal) value = (FAR(to) + FAR(n - layer)) - u[(n - layer) * s];
        else {
            const integer from = a.high == 1 ? n - layer - 1 : normal ? n : n - 1;
            value = u[from * s] + (FAR(to) - FAR(from));
        }
        u[to * s] = value;
    }
#undef FAR
}

// The velocity through an outflow is that of the face before it.
struct outflow_arguments {
    integer threads;
    struct grid g;
    double *u;
    integer axis, face, inner;
};

KERNEL(outflow) {
    THREAD
    const int d = (int)a.axis, first = (d + 1) % 3, second = (d + 2) % 3;
    const integer n = cells_along(a.g, first), s = stride(a.g, d);
    const integer p = thread % n, q = thread / n;
    double *u = a.u + at_cell(a.g, 0, 0, 0) + p * stride(a.g, first) + q * stride(a.g, second);
    u[a.face * s] = u[a.inner * s];
}

// ---- pressure (projection.rs, poisson.rs)

struct divergence_arguments {
    integer threads;
    struct grid g;
    const double *u[3], *widths[3];
    double *out;
};

KERNEL(divergence) {
    THREAD
    struct cell c = cell_of(a.g, thread);
    const double wx = a.widths[0][c.i[0]], wy = a.widths[1][c.i[1]], wz = a.widths[2][c.i[2]];
    const double x = a.u[0][c.at + 1] - a.u[0][c.at];
    const double y = a.u[1][c.at + a.g.sy] - a.u[1][c.at];
    const double z = a.u[2][c.at + a.g.sz] - a.u[2][c.at];
    a.out[thread] = -(x * (wy * wz) + wx * (y * wz + z * wy));
}

// The tridiagonal systems along z of the cells from start to start + count, one for each pair of modes.
struct along_z_arguments {
    integer threads;
    double *q;
    const double *pivots, *coupling, *closure;
    integer start, count;
};

// Values that a thread loads before it uses the first: a load takes far longer than what follows from it.
#define AHEAD 8

KERNEL(along_z) {
    THREAD
    const integer plane = a.threads;
    double *q = a.q + thread;
    const double *pivots = a.pivots + a.start * plane + thread, *coupling = a.coupling + a.start;
    double value = q[0], own[AHEAD], pivot[AHEAD];
    integer k = 1;
    for (; k + AHEAD <= a.count; k += AHEAD) {
        for (int i = 0; i < AHEAD; i++) {
            own[i] = q[(k + i) * plane];
            pivot[i] = pivots[(k + i - 1) * plane];
        }
        for (int i = 0; i < AHEAD; i++) {
            value = own[i] + coupling[k + i] * pivot[i] * value;
            q[(k + i) * plane] = value;
        }
    }
    for (; k < a.count; k++) {
        value = q[k * plane] + coupling[k] * pivots[(k - 1) * plane] * value;
        q[k * plane] = value;
    }
    value *= a.closure[thread];
    k = a.count - 1;
    q[k * plane] = value;
    for (; k >= AHEAD; k -= AHEAD) {
        for (int i = 0; i < AHEAD; i++) {
            own[i] = q[(k - 1 - i) * plane];
            pivot[i] = pivots[(k - 1 - i) * plane];
        }
        for (int i = 0; i < AHEAD; i++) {
            value = pivot[i] * (own[i] + coupling[k - i] * value);
            q[(k - 1 - i) * plane] = value;
        }
    }
    for (k--; k >= 0; k--) {
        value = pivots[k * plane] * (q[k * plane] + coupling[k + 1] * value);
        q[k * plane] = value;
    }
}

struct gradient_arguments {
    integer threads;
    struct grid g;
    const double *p;
    double *u[3];
    // Inverse distances of the centres across each face.
    const double *inverse[3];
    integer low[3], high[3], periodic[3];
};

KERNEL(gradient) {
    THREAD
    struct cell c = cell_of(a.g, thread);
    const integer step[3] = {1, a.g.nx, a.g.nx * a.g.ny};
    const double own = a.p[thread];
    for (int d = 0; d < 3; d++) {
        const integer i = c.i[d], n = cells_along(a.g, d);
        if (i > 0) a.u[d][c.at] -= (own - a.p[thread - step[d]]) * a.inverse[d][i];
        else if (a.low[d]) a.u[d][c.at] -= own * a.inverse[d][0];
        else if (a.periodic[d]) a.u[d][c.at] -= (own - a.p[thread + (n - 1) * step[d]]) * a.inverse[d][0];
        if (i == n - 1 && a.high[d]) a.u[d][c.at + stride(a.g, d)] += own * a.inverse[d][n];
    }
}

// ---- constraints (constraints.rs, pressure_jumps.rs)

// Velocity change at each face that the surface cuts, by the jumps of its rows.
struct impulses_arguments {
    integer threads;
    const double *jump;
    const unsigned *offsets, *row;
    const double *weight;
    double *impulse;
    double factor;
};

KERNEL(impulses) {
    THREAD
    double sum = 0.0;
    for (unsigned e = a.offsets[thread]; e < a.offsets[thread + 1]; e++) sum += a.weight[e] * a.jump[a.row[e]];
    a.impulse[thread] = a.factor * sum;
}

// Adds the velocity change at each face.
struct spread_arguments {
    integer threads;
    double *u[3];
    const unsigned *component, *position;
    const double *impulse;
};

KERNEL(spread) {
    THREAD
    a.u[a.component[thread]][a.position[thread]] += a.impulse[thread];
}

// What the velocity changes at faces take out of each cell.
struct sources_arguments {
    integer threads;
    const unsigned *cell, *offsets, *face;
    const double *area;
    const double *impulse;
    double *out;
};

KERNEL(sources) {
    THREAD
    double sum = 0.0;
    for (unsigned e = a.offsets[thread]; e < a.offsets[thread + 1]; e++) sum += a.area[e] * a.impulse[a.face[e]];
    a.out[a.cell[thread]] = sum;
}

// Flux of each row by its jump.
struct responses_arguments {
    integer threads;
    const unsigned *offsets, *face, *upper, *lower;
    const double *weight, *inverse, *impulse, *p, *leak, *jump;
    double *flux;
};

KERNEL(responses) {
    THREAD
    double sum = 0.0;
    for (unsigned e = a.offsets[thread]; e < a.offsets[thread + 1]; e++)
        sum += a.weight[e] * (a.impulse[a.face[e]] - (a.p[a.upper[e]] - a.p[a.lower[e]]) * a.inverse[e]);
    a.flux[thread] = sum + a.leak[thread] * a.jump[thread];
}

// Flux and largest speed of each row in a velocity less the gradient of a pressure.
struct fluxes_arguments {
    integer threads;
    const double *u[3], *p;
    const unsigned *offsets, *component, *position, *upper, *lower;
    const double *weight, *inverse;
    double *flux, *speed;
};

KERNEL(fluxes) {
    THREAD
    double sum = 0.0, largest = 0.0;
    for (unsigned e = a.offsets[thread]; e < a.offsets[thread + 1]; e++) {
        const double u = a.u[a.component[e]][a.position[e]] - (a.p[a.upper[e]] - a.p[a.lower[e]]) * a.inverse[e];
        sum += a.weight[e] * u;
        largest = MATH(fmax)(largest, MATH(fabs)(u));
    }
    a.flux[thread] = sum;
    a.speed[thread] = largest;
}

// ---- largest values (flow.rs): each thread those of its share of the cells

// Largest of each share of values, one array after the other.
struct reduce_arguments {
    integer threads;
    const double *values;
    double *largest;
    integer shares, each;
};

// A number that is none passes as it is.
FUNCTION double larger(double most, double value) {
    return value > most || value != value ? value : most;
}

KERNEL(reduce) {
    THREAD
    const double *values = a.values + thread / a.shares * a.shares * a.each + thread % a.shares;
    double most = values[0];
    for (integer i = 1; i < a.each; i++) most = larger(most, values[i * a.shares]);
    a.largest[thread] = most;
}

struct largest_arguments {
    integer threads;
    struct grid g;
    const double *u[3], *inverse_width[3], *p;
    double frame[3];
    // Courant rate, speed, negative and positive pressure.
    double *rate, *speed, *low, *high;
};

KERNEL(largest) {
    THREAD
    const integer cells = a.g.nx * a.g.ny * a.g.nz;
    double rate = 0.0, square = 0.0, low = -1e300, high = -1e300;
    for (integer t = thread; t < cells; t += a.threads) {
        struct cell c = cell_of(a.g, t);
        double sum = 0.0, speed = 0.0;
        for (int d = 0; d < 3; d++) {
            const double below = a.u[d][c.at] - a.frame[d], above = a.u[d][c.at + stride(a.g, d)] - a.frame[d];
            sum += larger(MATH(fabs)(below), MATH(fabs)(above)) * a.inverse_width[d][c.i[d]];
            speed += 0.25 * (below + above) * (below + above);
        }
        rate = larger(rate, sum);
        square = larger(square, speed);
        low = larger(low, -a.p[t]);
        high = larger(high, a.p[t]);
    }
    a.rate[thread] = rate;
    a.speed[thread] = MATH(sqrt)(square);
    a.low[thread] = low;
    a.high[thread] = high;
}

// ---- eddy viscosity (eddy_viscosity.rs, eddy_stress.rs)

// Inverse distances of the centres across each face, inverse widths from the cell below the grid on, widths to the power of two thirds.
struct lengths {
    const double *distance[3], *width[3], *filter[3];
};

struct viscosities_arguments {
    integer threads;
    struct grid g;
    const double *u[3];
    struct lengths lengths;
    double *viscosity;
    // 0 Smagorinsky, 1 WALE.
    integer model;
    double constant;
};

struct gradient_tensor {
    double g[3][3];
};

FUNCTION double strain_squared(const struct gradient_tensor *t) {
    const double xy = t->g[0][1] + t->g[1][0], yz = t->g[1][2] + t->g[2][1], xz = t->g[0][2] + t->g[2][0];
    return t->g[0][0] * t->g[0][0] + t->g[1][1] * t->g[1][1] + t->g[2][2] * t->g[2][2] +
           0.5 * (xy * xy + yz * yz + xz * xz);
}

FUNCTION double squared_gradient(const struct gradient_tensor *t, int c, int d) {
    return t->g[c][0] * t->g[0][d] + t->g[c][1] * t->g[1][d] + t->g[c][2] * t->g[2][d];
}

FUNCTION double traceless_squared(const struct gradient_tensor *t) {
    double a = squared_gradient(t, 0, 0), b = squared_gradient(t, 1, 1), c = squared_gradient(t, 2, 2);
    const double third = (a + b + c) / 3.0;
    a -= third;
    b -= third;
    c -= third;
    const double xy = squared_gradient(t, 0, 1) + squared_gradient(t, 1, 0);
    const double yz = squared_gradient(t, 1, 2) + squared_gradient(t, 2, 1);
    const double xz = squared_gradient(t, 0, 2) + squared_gradient(t, 2, 0);
    return a * a + b * b + c * c + 0.5 * (xy * xy + yz * yz + xz * xz);
}

KERNEL(viscosities) {
    THREAD
    const struct cell c = cell_of(a.g, thread);
    double s2 = 0.0, d2 = 0.0;
    // Corners of which each pair of axes has all four edges.
    for (int corner = 0; corner < 4; corner++) {
        const int o[3] = {corner >> 1, corner == 1 || corner == 3, corner == 1 || corner == 2};
        struct gradient_tensor t;
        for (int own = 0; own < 3; own++) {
            for (int d = 0; d < 3; d++) {
                const integer s = stride(a.g, d);
                const double *u = a.u[own];
                if (own == d) {
                    t.g[own][d] = (u[c.at + s] - u[c.at]) * a.lengths.width[d][c.i[d] + 1];
                } else {
                    const integer upper = c.at + o[own] * stride(a.g, own) + o[d] * s;
                    t.g[own][d] = (u[upper] - u[upper - s]) * a.lengths.distance[d][c.i[d] + o[d]];
                }
            }
        }
        s2 += 0.25 * strain_squared(&t);
        if (a.model == 1) d2 += 0.25 * traceless_squared(&t);
    }
    double rate = MATH(sqrt)(2.0 * s2);
    // Where nothing turns or stretches both are zero.
    if (a.model == 1)
        rate = d2 * MATH(sqrt)(d2) /
               (s2 * s2 * MATH(sqrt)(s2) + d2 * MATH(sqrt)(MATH(sqrt)(d2)) + 2.2250738585072014e-308);
    const double filter = a.lengths.filter[0][c.i[0]] * a.lengths.filter[1][c.i[1]] * a.lengths.filter[2][c.i[2]];
    a.viscosity[c.at] = filter * (a.constant * a.constant) * rate;
}

// Cells that use a difference across the surface have none.
struct clear_crossed_arguments {
    integer threads;
    const unsigned *position;
    double *viscosity;
};

KERNEL(clear_crossed) {
    THREAD
    a.viscosity[a.position[thread]] = 0.0;
}

// One layer of ghosts: x, then y with the ghosts along x, then z with both.
struct viscosity_ghosts_arguments {
    integer threads;
    struct grid g;
    double *viscosity;
    integer axis, periodic;
};

KERNEL(viscosity_ghosts) {
    THREAD
    const int d = (int)a.axis, first = d == 0 ? 1 : 0, second = d == 2 ? 1 : 2;
    const integer ghosts = d == 0 ? 0 : 1, more = d == 2 ? 1 : 0;
    const integer extent = cells_along(a.g, first) + 2 * ghosts, n = cells_along(a.g, d), s = stride(a.g, d);
    const integer p = thread % extent - ghosts, q = thread / extent - more;
    double *v = a.viscosity + at_cell(a.g, 0, 0, 0) + p * stride(a.g, first) + q * stride(a.g, second);
    v[-s] = a.periodic ? v[(n - 1) * s] : v[0];
    v[n * s] = a.periodic ? v[0] : v[(n - 1) * s];
}

struct stresses_arguments {
    integer threads;
    struct grid g;
    const double *u[3];
    struct lengths lengths;
    const double *viscosity;
    double *rates;
    integer component;
};

FUNCTION double normal_stress(const struct stresses_arguments *a, const integer p, const integer i, const int own) {
    const double *u = a->u[own];
    return 2.0 * a->viscosity[p] * ((u[p + stride(a->g, own)] - u[p]) * a->lengths.width[own][i + 1]);
}

// On the edge at the lower faces of p along both axes, whose indices are i and m.
FUNCTION double shear_stress(
    const struct stresses_arguments *a, const integer p, const integer i, const int own, const integer m, const int d
) {
    const integer s = stride(a->g, own), t = stride(a->g, d);
    const double *v = a->viscosity, *u = a->u[own], *w = a->u[d];
    const double viscosity = 0.25 * ((v[p] + v[p - s]) + (v[p - t] + v[p - s - t]));
    return viscosity * ((u[p] - u[p - t]) * a->lengths.distance[d][m] + (w[p] - w[p - s]) * a->lengths.distance[own][i]);
}

FUNCTION double along_shear(const struct stresses_arguments *a, const struct cell *c, const int own, const int d) {
    const integer i = c->i[own], m = c->i[d];
    return (shear_stress(a, c->at + stride(a->g, d), i, own, m + 1, d) - shear_stress(a, c->at, i, own, m, d)) *
           a->lengths.width[d][m + 1];
}

FUNCTION double stress_of(const struct stresses_arguments *a, const struct cell *c, const int own) {
    const integer i = c->i[own];
    return (normal_stress(a, c->at, i, own) - normal_stress(a, c->at - stride(a->g, own), i - 1, own)) *
               a->lengths.distance[own][i] +
           along_shear(a, c, own, (own + 1) % 3) + along_shear(a, c, own, (own + 2) % 3);
}

KERNEL(stresses) {
    THREAD
    const struct cell c = cell_of(a.g, thread);
    const integer own = a.component;
    a.rates[c.at] += own == 0 ? stress_of(&a, &c, 0) : own == 1 ? stress_of(&a, &c, 1) : stress_of(&a, &c, 2);
}

struct largest_viscosity_arguments {
    integer threads;
    struct grid g;
    struct lengths lengths;
    const double *viscosity;
    double *rate;
};

KERNEL(largest_viscosity) {
    THREAD
    const integer cells = a.g.nx * a.g.ny * a.g.nz;
    double most = 0.0;
    for (integer t = thread; t < cells; t += a.threads) {
        const struct cell c = cell_of(a.g, t);
        double sum = 0.0;
        for (int d = 0; d < 3; d++) {
            const double width = a.lengths.width[d][c.i[d] + 1];
            sum += width * width;
        }
        most = larger(most, 4.0 * a.viscosity[c.at] * sum);
    }
    a.rate[thread] = most;
}
