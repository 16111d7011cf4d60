// Inverse-distance interpolation in place of the mesh-mover.
//
// Each node of the grid between canopy and outer boundary moves by the mean of their displacements, weighted by (L/r)^3 + (L/r)^5 with
// its distance r to their nodes; the outer boundary stands still. The weights are those of the grid at the start and are kept, one for
// each pair of a free node and a canopy node: for small grids. Every process moves its own share of the nodes.

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "ripstop.hpp"

namespace {

using Vec3 = std::array<double, 3>;

// Faces of a hexahedron, seen from outside.
const int sides[6][4] = {{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4}, {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}};

Vec3 minus(const Vec3 &a, const Vec3 &b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }

double distance2(const Vec3 &a, const Vec3 &b) {
    const Vec3 d = minus(a, b);
    return d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
}

Vec3 at(const double *rows, std::size_t row) { return {rows[3 * row], rows[3 * row + 1], rows[3 * row + 2]}; }

// Volume of a hexahedron, also of one that repeats nodes, m3.
double volume(const std::uint32_t *cell, const std::vector<double> &x) {
    double total = 0.0;
    for (const auto &side : sides) {
        const Vec3 a = at(x.data(), cell[side[0]]), b = at(x.data(), cell[side[1]]);
        const Vec3 c = at(x.data(), cell[side[2]]), d = at(x.data(), cell[side[3]]);
        const Vec3 p = minus(c, a), q = minus(d, b);
        const Vec3 area = {p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]};
        double sum = 0.0;
        for (int i = 0; i < 3; ++i) sum += 0.25 * (a[i] + b[i] + c[i] + d[i]) * area[i];
        total += sum / 6.0;
    }
    return total;
}

class InverseDistance : public ripstop::Participant {
public:
    explicit InverseDistance(const ripstop::Data &data)
        : Participant(data),
          structure(data.structure()),
          grid(data.grid()),
          own(data.share(grid.nodes)),
          now(grid.coords, grid.coords + 3 * grid.nodes),
          before(now),
          trial(now) {
        weigh();
        for (std::size_t k = 0; k < grid.cells; ++k) volumes.push_back(volume(grid.corners + 8 * k, now));
    }

    void advance(const ripstop_window &window, const ripstop_input &input, double *output, double *statistics) override {
        move(input.canopy);
        double smallest = std::numeric_limits<double>::infinity();
        std::size_t worst = 0;
        for (std::size_t k = 0; k < grid.cells; ++k) {
            const double ratio = volume(grid.corners + 8 * k, trial) / volumes[k];
            if (ratio < smallest) smallest = ratio, worst = k;
        }
        if (smallest <= 0.0)
            throw ripstop::Fault("cell " + std::to_string(worst) + " is turned inside out in window " +
                                 std::to_string(window.index) + " (its volume is " + std::to_string(smallest) +
                                 " of that at the start): shorter windows or the project's own mesh-mover may help");
        // The rate that the flow's time differences have too, so that a uniform stream stays uniform.
        double c[3] = {1.0, -1.0, 0.0};
        if (last_dt > 0.0) ripstop::check(ripstop_bdf2(window.dt / last_dt, c));
        for (std::size_t row = own.first; row < own.second; ++row, output += 6) {
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const std::size_t i = 3 * row + axis;
                output[axis] = trial[i];
                output[3 + axis] = (c[0] * trial[i] + c[1] * now[i] + c[2] * before[i]) / window.dt;
            }
        }
        statistics[RIPSTOP_MESH_MIN_VOLUME_RATIO] = smallest;
        statistics[RIPSTOP_MESH_WORST_CELL] = double(worst);
        trial_dt = window.dt;
    }

    void accept(const ripstop_window &) override {
        before = now;
        now = trial;
        last_dt = trial_dt;
    }

    void save(const char *folder) override {
        if (data.rank() != 0) return;
        std::vector<double> values = now;
        values.insert(values.end(), before.begin(), before.end());
        values.push_back(last_dt);
        data.save_numbers(folder, values);
    }

    void restore(const char *file) override {
        std::vector<double> values(6 * grid.nodes + 1);
        ripstop::load_numbers(file, values);
        const auto middle = values.begin() + std::ptrdiff_t(3 * grid.nodes);
        now.assign(values.begin(), middle);
        before.assign(middle, values.end() - 1);
        last_dt = values.back();
    }

private:
    // Fills `weights`.
    void weigh() {
        const std::size_t none = structure.canopy_nodes;
        std::vector<std::size_t> canopy_node(grid.nodes, none);
        for (std::size_t i = 0; i < none; ++i) canopy_node[grid.canopy_nodes[i]] = i;
        std::vector<bool> outer(grid.nodes, false);
        for (std::size_t k = 0; k < 4 * grid.boundary_faces; ++k) outer[grid.boundary[k]] = true;
        std::vector<Vec3> still, canopy;
        for (std::size_t i = 0; i < grid.nodes; ++i)
            if (outer[i] && canopy_node[i] == none) still.push_back(at(grid.coords, i));
        for (std::size_t j = 0; j < none; ++j) canopy.push_back(at(grid.coords, grid.canopy_nodes[j]));
        double far = 0.0;
        for (const Vec3 &x : still) far = std::max(far, distance2(x, canopy[0]));
        far = std::sqrt(far);
        const double length2 = std::pow(far / 5.0, 2);
        auto weight = [&](const Vec3 &a, const Vec3 &b) {
            const double s = length2 / std::max(distance2(a, b), 1e-12 * length2);
            return std::pow(s, 1.5) + std::pow(s, 2.5);
        };
        weights.resize(grid.nodes);
        for (std::size_t i = 0; i < grid.nodes; ++i) {
            const Vec3 x = at(grid.coords, i);
            if (canopy_node[i] != none) {
                weights[i].assign(none, 0.0);
                weights[i][canopy_node[i]] = 1.0;
            } else if (!outer[i]) {
                double near = 0.0, rest = 0.0;
                for (const Vec3 &node : canopy) weights[i].push_back(weight(x, node));
                for (double w : weights[i]) near += w;
                for (const Vec3 &node : still) rest += weight(x, node);
                for (double &w : weights[i]) w /= near + rest;
            }
        }
    }

    // Positions of the grid for the displacement of the canopy, into `trial`.
    void move(const double *displacement) {
        std::vector<Vec3> moved;
        for (std::size_t i = 0; i < structure.canopy_nodes; ++i) {
            const Vec3 rest = at(structure.coords, i), u = at(displacement, i);
            moved.push_back(minus({rest[0] + u[0], rest[1] + u[1], rest[2] + u[2]}, at(grid.coords, grid.canopy_nodes[i])));
        }
        for (std::size_t i = 0; i < grid.nodes; ++i) {
            for (std::size_t axis = 0; axis < 3; ++axis) {
                double sum = 0.0;
                for (std::size_t j = 0; j < weights[i].size(); ++j) sum += weights[i][j] * moved[j][axis];
                trial[3 * i + axis] = grid.coords[3 * i + axis] + sum;
            }
        }
    }

    const ripstop_structure structure;
    const ripstop_grid grid;
    const std::pair<std::size_t, std::size_t> own;  // grid nodes of this rank
    std::vector<double> volumes;                    // at the start, m3
    std::vector<std::vector<double>> weights;       // [grid nodes][canopy nodes]; empty for nodes that stand still
    // Positions at the end of the last two windows and of the one that was computed, [grid nodes][3], m.
    std::vector<double> now, before, trial;
    double last_dt = 0.0, trial_dt = 0.0;  // s; 0: there was no window
};

}  // namespace

int main(int argc, char **argv) {
    return ripstop::main<InverseDistance>(argc, argv, RIPSTOP_ROLE_MESH, "inverse-distance", "resume coupling.adaptive", true);
}
