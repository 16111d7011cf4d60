// A mass-spring canopy in place of the structure-solver.
//
// The fabric is a net: a spring along each edge of a face and along both its diagonals, which pull and never push. With edges of
// stiffness 3/4 E t and diagonals of 3/8 E t a square net stretches like an isotropic sheet of Poisson's ratio 1/3. Lines are springs
// too, masses lie in the nodes, and time advances in explicit (symplectic Euler) steps, as many in a window as are stable.

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "ripstop.hpp"

namespace {

using Vec3 = std::array<double, 3>;
using Field = std::vector<Vec3>;

const double safety = 0.7;  // share of the largest stable time step

Vec3 plus(const Vec3 &a, const Vec3 &b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }

Vec3 minus(const Vec3 &a, const Vec3 &b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }

Vec3 times(double s, const Vec3 &a) { return {s * a[0], s * a[1], s * a[2]}; }

double dot(const Vec3 &a, const Vec3 &b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

Vec3 cross(const Vec3 &a, const Vec3 &b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

struct Spring {
    std::size_t ends[2];
    double rest;       // unstressed length, m
    double stiffness;  // N/m
};

/// Displacements (m) and velocities (m/s) of all nodes.
struct State {
    Field u, v;
};

class MassSpring : public ripstop::Participant {
public:
    explicit MassSpring(const ripstop::Data &data)
        : Participant(data),
          mesh(data.structure()),
          coords(mesh.nodes),
          mass(mesh.nodes, 0.0),
          damping(data.stage_number_or("mass_damping_per_s", 0.0)) {
        if (data.ranks() != 1)
            throw ripstop::Fault("mass-spring is one process, " + std::to_string(data.ranks()) +
                                 " were asked for: use --ranks structure=1");
        for (std::size_t i = 0; i < mesh.nodes; ++i)
            coords[i] = {mesh.coords[3 * i], mesh.coords[3 * i + 1], mesh.coords[3 * i + 2]};
        weave();
        tie();
        // Gershgorin: the square of the highest frequency is at most twice the stiffness around a node by its mass.
        std::vector<double> around(mesh.nodes, 0.0);
        for (const Spring &s : springs)
            for (std::size_t node : s.ends) around[node] += s.stiffness;
        double highest = 0.0;
        for (std::size_t i = 0; i < mesh.nodes; ++i) {
            mass[i] += mesh.point_mass[i];
            const bool held = mesh.fixed[3 * i] && mesh.fixed[3 * i + 1] && mesh.fixed[3 * i + 2];
            if (!held) highest = std::max(highest, 2.0 * around[i] / mass[i]);
        }
        stable = safety * 2.0 / std::sqrt(highest);
        accepted = {Field(mesh.nodes, Vec3{}), Field(mesh.nodes, Vec3{})};
        trial = accepted;
    }

    void advance(const ripstop_window &window, const ripstop_input &input, double *output, double *statistics) override {
        const double steps = std::max(std::ceil(window.dt / stable), double(window.substeps));
        const double dt = window.dt / steps;
        const double keep = 1.0 / (1.0 + dt * damping);
        Field u = accepted.u, v = accepted.v;
        double work = 0.0;
        for (std::size_t step = 0; step < std::size_t(steps); ++step) {
            const Field x = positions(u);
            Field outside(u.size(), Vec3{});
            push(x, input.canopy, (double(step) + 0.5) / steps, outside);
            Field force = outside;
            pull(x, force);
            for (std::size_t i = 0; i < u.size(); ++i) {
                for (int axis = 0; axis < 3; ++axis) {
                    if (mesh.fixed[3 * i + axis]) continue;
                    v[i][axis] = keep * (v[i][axis] + dt * force[i][axis] / mass[i]);
                    u[i][axis] += dt * v[i][axis];
                }
                work += dt * dot(outside[i], v[i]);
            }
        }
        for (const Vec3 &ui : u)
            if (!std::isfinite(ui[0] + ui[1] + ui[2]))
                throw ripstop::Fault("the net diverged in window " + std::to_string(window.index) + " (t = " +
                                     std::to_string(window.time) + " s)");
        for (std::size_t i = 0; i < mesh.canopy_nodes; ++i) std::copy(u[i].begin(), u[i].end(), output + 3 * i);
        const Field x = positions(u);
        Field unused(u.size(), Vec3{});
        const auto load = push(x, input.canopy, 1.0, unused);
        const auto springs = pull(x, unused);
        double kinetic = 0.0;
        for (std::size_t i = 0; i < v.size(); ++i) kinetic += 0.5 * mass[i] * dot(v[i], v[i]);
        statistics[RIPSTOP_STRUCTURE_KINETIC_ENERGY] = kinetic;
        statistics[RIPSTOP_STRUCTURE_STRAIN_ENERGY] = springs.first;
        statistics[RIPSTOP_STRUCTURE_LOAD_WORK] = work;
        statistics[RIPSTOP_STRUCTURE_VERTICAL_LOAD] = load.first;
        statistics[RIPSTOP_STRUCTURE_PROJECTED_AREA] = load.second;
        statistics[RIPSTOP_STRUCTURE_MAX_LINE_TENSION] = springs.second;
        trial = {std::move(u), std::move(v)};
    }

    void accept(const ripstop_window &) override { accepted = trial; }

    void save(const char *folder) override {
        const Field x = positions(accepted.u);
        ripstop::check(ripstop_write_shape(folder, x[0].data(), mesh.canopy_nodes));
        std::vector<double> values;
        for (const Field *field : {&accepted.u, &accepted.v})
            for (const Vec3 &value : *field) values.insert(values.end(), value.begin(), value.end());
        data.save_numbers(folder, values);
    }

    void restore(const char *file) override {
        std::vector<double> values(6 * mesh.nodes);
        ripstop::load_numbers(file, values);
        auto next = values.begin();
        for (Field *field : {&accepted.u, &accepted.v})
            for (Vec3 &value : *field)
                for (double &component : value) component = *next++;
        trial = accepted;
    }

private:
    Field positions(const Field &u) const {
        Field x(u.size());
        for (std::size_t i = 0; i < u.size(); ++i) x[i] = plus(coords[i], u[i]);
        return x;
    }

    // Springs of the fabric, and its mass. An edge is shared by two faces and has half its stiffness from each.
    void weave() {
        const double thickness = data.number("fabric.thickness_m");
        const double sheet = data.number("fabric.youngs_modulus_pa") * thickness;
        const double areal_mass = data.number("fabric.density_kg_m3") * thickness;
        std::map<std::pair<std::size_t, std::size_t>, double> stiffness;
        for (std::size_t face = 0; face < mesh.faces; ++face) {
            const std::uint32_t *n = mesh.corners + 4 * face;
            const Vec3 normal = cross(minus(coords[n[2]], coords[n[0]]), minus(coords[n[3]], coords[n[1]]));
            const double area = 0.5 * std::sqrt(dot(normal, normal));
            const int corners = n[2] == n[3] ? 3 : 4;
            for (int k = 0; k < corners; ++k) mass[n[k]] += area * areal_mass / corners;
            const int ends[6][2] = {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {0, 2}, {1, 3}};
            for (int k = 0; k < (corners == 4 ? 6 : 4); ++k) {
                const std::size_t i = n[ends[k][0]], j = n[ends[k][1]];
                if (i == j) continue;
                const Vec3 along = minus(coords[j], coords[i]);
                stiffness[{std::min(i, j), std::max(i, j)}] += (k < 4 ? 0.375 : 0.75) * sheet * area / dot(along, along);
            }
        }
        for (const auto &entry : stiffness) {
            const Vec3 along = minus(coords[entry.first.second], coords[entry.first.first]);
            springs.push_back({{entry.first.first, entry.first.second}, std::sqrt(dot(along, along)), entry.second});
        }
        fabric_springs = springs.size();
    }

    // Springs of the lines, and their mass.
    void tie() {
        const double modulus = data.number("lines.youngs_modulus_pa"), section = data.number("lines.area_m2");
        const double density = data.number("lines.density_kg_m3");
        for (std::size_t k = 0; k < mesh.cables; ++k) {
            const std::size_t i = mesh.cable_ends[2 * k], j = mesh.cable_ends[2 * k + 1];
            const double rest = mesh.cable_length[k];
            springs.push_back({{i, j}, rest, modulus * section / rest});
            for (std::size_t node : {i, j}) mass[node] += 0.5 * density * section * rest;
        }
    }

    // Adds the forces of the springs (N); returns strain energy (J) and largest tension of a line (N).
    std::pair<double, double> pull(const Field &x, Field &force) const {
        double energy = 0.0, largest = 0.0;
        for (std::size_t k = 0; k < springs.size(); ++k) {
            const Spring &spring = springs[k];
            const std::size_t i = spring.ends[0], j = spring.ends[1];
            const Vec3 along = minus(x[j], x[i]);
            const double length = std::sqrt(dot(along, along));
            const double tension = spring.stiffness * std::max(length - spring.rest, 0.0);
            const Vec3 pull = {along[0] * tension / length, along[1] * tension / length, along[2] * tension / length};
            force[i] = plus(force[i], pull);
            force[j] = minus(force[j], pull);
            energy += 0.5 * tension * tension / spring.stiffness;
            if (k >= fabric_springs) largest = std::max(largest, tension);
        }
        return {energy, largest};
    }

    // Adds the forces of the load between the start (0) and the end (1) of the window; returns vertical load (N) and projected area (m2).
    std::pair<double, double> push(const Field &x, const double *load, double time, Field &force) const {
        double vertical = 0.0, projected = 0.0;
        for (std::size_t face = 0; face < mesh.faces; ++face, load += 8) {
            const std::uint32_t *n = mesh.corners + 4 * face;
            const Vec3 area = times(0.5, cross(minus(x[n[2]], x[n[0]]), minus(x[n[3]], x[n[1]])));
            const double size = std::sqrt(dot(area, area));
            auto now = [&](int i) { return (1.0 - time) * load[i] + time * load[4 + i]; };
            Vec3 whole;
            for (int i = 0; i < 3; ++i) whole[i] = now(0) * area[i] + now(1 + i) * size;
            const int corners = n[2] == n[3] ? 3 : 4;
            for (int k = 0; k < corners; ++k)
                force[n[k]] = plus(force[n[k]], {whole[0] / corners, whole[1] / corners, whole[2] / corners});
            vertical += whole[2];
            projected += area[2];
        }
        return {vertical, std::fabs(projected)};
    }

    const ripstop_structure mesh;
    Field coords;  // unstressed, m
    std::vector<Spring> springs;  // of the fabric, then the lines
    std::size_t fabric_springs = 0;
    std::vector<double> mass;  // kg
    const double damping;      // 1/s
    double stable = 0.0;       // largest stable time step, s
    State accepted, trial;
};

}  // namespace

int main(int argc, char **argv) {
    const char *effects = "fabric.wrinkling lines resume coupling.adaptive";
    return ripstop::main<MassSpring>(argc, argv, RIPSTOP_ROLE_STRUCTURE, "mass-spring", effects, false);
}
