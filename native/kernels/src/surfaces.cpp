#include "surfaces.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "parallel.hpp"

namespace gs {
namespace {

constexpr double kSlack = 1e-5;  // samples by which triangles are wider, so that no sample falls between two
constexpr double kNear = 1e-6;   // of a triangle's farthest corner: what is nearer to the plane of the eye has no bounds

struct Vector {
    double x, y, z;
};

Vector operator-(const Vector& a, const Vector& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
Vector operator*(double s, const Vector& a) { return {s * a.x, s * a.y, s * a.z}; }
Vector operator+(const Vector& a, const Vector& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
double dot(const Vector& a, const Vector& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
Vector cross(const Vector& a, const Vector& b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
Vector vector(const double* v) { return {v[0], v[1], v[2]}; }

// Homogeneous places in the picture: column times distance, row times distance, distance along the view.
std::vector<Vector> projected(const double* places, int64_t count, const CastRays& rays) {
    const Vector across = vector(rays.across), down = vector(rays.down), corner = vector(rays.corner), eye = vector(rays.eye);
    const double per_volume = 1.0 / dot(across, cross(down, corner));
    const Vector rows[3] = {per_volume * cross(down, corner), per_volume * cross(corner, across), per_volume * cross(across, down)};
    std::vector<Vector> out(static_cast<size_t>(count));
    for (int64_t k = 0; k < count; ++k) {
        const Vector away = vector(places + 3 * k) - eye;
        out[size_t(k)] = {dot(rows[0], away), dot(rows[1], away), dot(rows[2], away)};
    }
    return out;
}

// The samples whose middles the part of a triangle that lies before the eye may cover.
void bound(const Vector h[3], const CastRays& rays, int32_t box[4]) {
    const double infinity = std::numeric_limits<double>::infinity(), near = kNear * std::max({h[0].z, h[1].z, h[2].z});
    double low[2] = {infinity, infinity}, high[2] = {-infinity, -infinity};
    const auto hold = [&](const Vector& place, double distance) {
        const double at[2] = {place.x / distance, place.y / distance};
        for (int k = 0; k < 2; ++k) low[k] = std::min(low[k], at[k]), high[k] = std::max(high[k], at[k]);
    };
    for (int k = 0; k < 3 && near > 0.0; ++k) {
        const Vector &from = h[k], &to = h[(k + 1) % 3];
        if (from.z > near) hold(from, from.z);
        if ((from.z > near) != (to.z > near)) hold(from + ((near - from.z) / (to.z - from.z)) * (to - from), near);
    }
    const int size[2] = {rays.width, rays.height};
    for (int k = 0; k < 2; ++k) {
        box[k] = int32_t(std::ceil(std::clamp(low[k] - 0.5 - kSlack, 0.0, double(size[k]))));
        box[2 + k] = int32_t(std::floor(std::clamp(high[k] + 0.5 + kSlack, 0.0, double(size[k]))));
    }
}

// The row of a triangle, see CastSurface; false where nothing of it is seen.  `farthest` is one over the largest distance of all.
bool describe(const Mesh& mesh, const int32_t* corners, const std::vector<Vector>& all, double farthest, const CastRays& rays,
              float* row, int32_t* box) {
    Vector h[3] = {all[size_t(corners[0])], all[size_t(corners[1])], all[size_t(corners[2])]};
    bound(h, rays, box);
    if (box[0] >= box[2] || box[1] >= box[3]) return false;
    for (Vector& place : h) place = {place.x - (box[0] + 0.5) * place.z, place.y - (box[1] + 0.5) * place.z, place.z};
    const double per_volume = 1.0 / dot(h[0], cross(h[1], h[2])), first[3] = {double(box[0]), double(box[1]), 0.0};
    bool finite = true;
    Vector closeness = {0.0, 0.0, -farthest};
    for (int k = 0; k < 3; ++k) {
        const Vector edge = per_volume * cross(h[(k + 1) % 3], h[(k + 2) % 3]);
        const double* normal = mesh.normals + 3 * int64_t(corners[k]);
        closeness = closeness + edge;
        const double slack = kSlack * (std::abs(edge.x) + std::abs(edge.y));
        const double numbers[4] = {edge.x, edge.y, edge.z + slack, first[k]};
        for (int j = 0; j < 4; ++j) row[4 * k + j] = float(numbers[j]), row[12 + 4 * k + j] = float(j < 3 ? normal[j] : 0.0);
        for (int j = 0; j < 3; ++j) finite = finite && std::isfinite(row[4 * k + j]);
    }
    row[15] = float(closeness.x), row[19] = float(closeness.y), row[23] = float(closeness.z);
    return finite;
}

}  // namespace

void draw_surface(const Mesh& mesh, int64_t places, CastSurface surface, const CastRays& rays, const Kernels& kernels, int threads,
                  float* picture) {
    const std::vector<Vector> all = projected(mesh.places, places, rays);
    const int across = (rays.width + kSurfaceTile - 1) / kSurfaceTile, down = (rays.height + kSurfaceTile - 1) / kSurfaceTile;
    std::vector<float> rows;
    std::vector<int32_t> boxes;
    std::vector<std::vector<int32_t>> in_tiles(size_t(across) * size_t(down));
    double largest = 0.0;
    for (const Vector& place : all) largest = std::max(largest, place.z);
    float row[kTriangleColumns];
    int32_t box[4];
    for (int64_t t = 0; t < mesh.count; ++t) {
        if (!describe(mesh, mesh.corners + 3 * t, all, 1.0 / largest, rays, row, box)) continue;
        for (int y = box[1] / kSurfaceTile; y <= (box[3] - 1) / kSurfaceTile; ++y)
            for (int x = box[0] / kSurfaceTile; x <= (box[2] - 1) / kSurfaceTile; ++x)
                in_tiles[size_t(y * across + x)].push_back(int32_t(boxes.size() / 4));
        rows.insert(rows.end(), row, row + kTriangleColumns);
        boxes.insert(boxes.end(), box, box + 4);
    }
    surface.rows = rows.data(), surface.boxes = boxes.data();
    parallel(int64_t(in_tiles.size()), threads, [&](int64_t tile) {
        const std::vector<int32_t>& own = in_tiles[size_t(tile)];
        const int left = int(tile % across) * kSurfaceTile, top = int(tile / across) * kSurfaceTile;
        const int sides[4] = {left, top, std::min(left + kSurfaceTile, rays.width), std::min(top + kSurfaceTile, rays.height)};
        if (!own.empty()) kernels.surface_tile(surface, rays, own.data(), int64_t(own.size()), sides, picture);
    });
}

}  // namespace gs
