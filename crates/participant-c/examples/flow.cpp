// A flow model of one equation in place of the flow-solver.
//
// The air inside an inflated canopy is at rest relative to it, so the pressure jump is nearly the same on the whole canopy:
//
//     jump = 1/2 rho c |u| u,    u = w . e_z - v_face . n,
//
// with the density rho, a pressure coefficient c, the velocity w of the air relative to the frame of the payload, and the velocity
// v_face and unit normal n of a face.

#include <array>
#include <cmath>

#include "ripstop.hpp"

namespace {

using Vec3 = std::array<double, 3>;

const double density = 1.225;    // kg/m3
const double coefficient = 1.5;  // pressure jump over dynamic pressure

Vec3 minus(const Vec3 &a, const Vec3 &b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }

double dot(const Vec3 &a, const Vec3 &b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

Vec3 cross(const Vec3 &a, const Vec3 &b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

class StagnationFlow : public ripstop::Participant {
public:
    explicit StagnationFlow(const ripstop::Data &data)
        : Participant(data),
          structure(data.structure()),
          grid(data.grid()),
          wind(data.number("flow.wind_m_s.2")),
          own(data.share(structure.faces)) {}

    // Where the grid moves, its nodes on the canopy.
    std::vector<std::uint64_t> grid_rows() override {
        return {grid.canopy_nodes, grid.canopy_nodes + structure.canopy_nodes};
    }

    void advance(const ripstop_window &window, const ripstop_input &input, double *output, double *statistics) override {
        // The frame falls with the payload: the air comes from below.
        const double air = wind - window.frame_velocity[2];
        for (std::size_t face = 0; face < structure.faces; ++face) {
            Vec3 x[4], v[4];
            for (int i = 0; i < 4; ++i) corner(structure.corners[4 * face + i], input, x[i], v[i]);
            Vec3 area = cross(minus(x[2], x[0]), minus(x[3], x[1]));
            Vec3 velocity;
            for (int axis = 0; axis < 3; ++axis) {
                area[axis] *= 0.5;
                velocity[axis] = 0.25 * (v[0][axis] + v[1][axis] + v[2][axis] + v[3][axis]);
            }
            const double u = air - dot(velocity, area) / std::sqrt(dot(area, area));
            const double jump = 0.5 * density * coefficient * std::fabs(u) * u;
            if (own.first <= face && face < own.second) {
                double *row = output + 4 * (face - own.first);
                row[0] = jump;
                row[1] = row[2] = row[3] = 0.0;  // no friction
            }
            // Global values, the same on each rank.
            for (int axis = 0; axis < 3; ++axis) statistics[RIPSTOP_FLOW_FORCE + axis] += jump * area[axis];
        }
    }

private:
    // Position (m) and velocity (m/s) of a canopy node.
    void corner(std::uint32_t node, const ripstop_input &input, Vec3 &x, Vec3 &v) const {
        if (input.grid == nullptr) {
            // In a stage without a mesh-mover the canopy is held still.
            const double *start = grid.coords + 3 * grid.canopy_nodes[node];
            x = {start[0], start[1], start[2]};
            v = {0.0, 0.0, 0.0};
            return;
        }
        const double *row = input.grid + 6 * std::size_t(node);
        x = {row[0], row[1], row[2]};
        v = {row[3], row[4], row[5]};
    }

    const ripstop_structure structure;
    const ripstop_grid grid;
    const double wind;  // vertical velocity of the wind, m/s
    const std::pair<std::size_t, std::size_t> own;  // faces of this rank
};

}  // namespace

int main(int argc, char **argv) {
    return ripstop::main<StagnationFlow>(argc, argv, RIPSTOP_ROLE_FLOW, "stagnation-flow", "resume coupling.adaptive", true);
}
