// Rasterises many meshes into small patches: nearest face of each pixel, then its normal and colour.
// Compiled at run time for a GPU (cuda_renderer.py), and by a C++ compiler for tests without one.
//
// Of all meshes, one behind the other: corners (F, 9): three corners of each face, centred frame.
// values (F, 18): at each corner a normal and three numbers, which are texture coordinates u, v and 0,
// or red, green and blue in 0..255. texels (T, 3). places (S, 2): a mesh's first face and first texel.
// meta (S, 4): faces, levels of the texture (0: colours are those of the corners), 1 if it repeats, -.
// measures (S, 2): texels a metre, radius. levels (S, 12, 3): first texel (of the mesh's), height, width of
// each level.
// pose (B, 12): rotation by rows, translation. camera (B, 4): fx, fy, cx, cy.

#ifdef __CUDACC__
#define KERNEL extern "C" __global__ void
#define KEEP_NEAREST(where, key) atomicMin(where, key)
#define DEPTH_BITS(z) __float_as_uint(z)
#define BITS_DEPTH(u) __uint_as_float(u)
#else
#include <cmath>
#include <cstring>
#define KERNEL static void
struct Index { int x, y; };
static Index blockIdx, threadIdx, blockDim;
static void KEEP_NEAREST(unsigned long long* where, unsigned long long key) { if (key < *where) *where = key; }
static unsigned DEPTH_BITS(float z) { unsigned u; std::memcpy(&u, &z, 4); return u; }
static float BITS_DEPTH(unsigned u) { float z; std::memcpy(&z, &u, 4); return z; }
#define __device__ static
using std::sqrt; using std::floor; using std::log2;
#endif

struct Corner { float x, y, z; };

__device__ inline Corner seen(const float* p, const float* pose) {
    Corner c;
    c.x = pose[0] * p[0] + pose[1] * p[1] + pose[2] * p[2] + pose[9];
    c.y = pose[3] * p[0] + pose[4] * p[1] + pose[5] * p[2] + pose[10];
    c.z = pose[6] * p[0] + pose[7] * p[1] + pose[8] * p[2] + pose[11];
    return c;
}

// Shares of the corners at pixel (x, y); false where the face is seen edge-on.
struct Projected { float u[3], v[3], w[3], area; };

__device__ inline bool project(const float* face, const float* pose, const float* camera, Projected* out) {
    for (int k = 0; k < 3; ++k) {
        Corner c = seen(face + 3 * k, pose);
        if (c.z < 1e-3f) return false;
        out->w[k] = 1.0f / c.z;
        out->u[k] = camera[0] * c.x * out->w[k] + camera[2];
        out->v[k] = camera[1] * c.y * out->w[k] + camera[3];
    }
    out->area = (out->u[1] - out->u[0]) * (out->v[2] - out->v[0]) - (out->u[2] - out->u[0]) * (out->v[1] - out->v[0]);
    return out->area > 1e-9f || out->area < -1e-9f;
}

__device__ inline void shares(const Projected& p, float x, float y, float* s) {
    float inverse = 1.0f / p.area;
    s[0] = ((p.u[1] - x) * (p.v[2] - y) - (p.u[2] - x) * (p.v[1] - y)) * inverse;
    s[1] = ((p.u[2] - x) * (p.v[0] - y) - (p.u[0] - x) * (p.v[2] - y)) * inverse;
    s[2] = 1.0f - s[0] - s[1];
}

KERNEL rasterize(const float* corners, const long long* places, const int* meta, const long long* mesh,
                 const float* pose, const float* camera, unsigned long long* nearest, int size) {
    int f = blockIdx.x * blockDim.x + threadIdx.x, b = blockIdx.y;
    long long slot = mesh[b];
    if (f >= meta[4 * slot]) return;
    Projected p;
    if (!project(corners + (places[2 * slot] + f) * 9, pose + 12 * b, camera + 4 * b, &p)) return;
    float left = p.u[0], right = p.u[0], top = p.v[0], bottom = p.v[0];
    for (int k = 1; k < 3; ++k) {
        left = p.u[k] < left ? p.u[k] : left; right = p.u[k] > right ? p.u[k] : right;
        top = p.v[k] < top ? p.v[k] : top; bottom = p.v[k] > bottom ? p.v[k] : bottom;
    }
    if (right < 0 || bottom < 0 || left > size - 1 || top > size - 1) return;
    int x0 = left > 0 ? (int)ceilf(left) : 0, x1 = right < size - 1 ? (int)floorf(right) : size - 1;
    int y0 = top > 0 ? (int)ceilf(top) : 0, y1 = bottom < size - 1 ? (int)floorf(bottom) : size - 1;
    unsigned long long* patch = nearest + (long long)b * size * size;
    for (int y = y0; y <= y1; ++y)
        for (int x = x0; x <= x1; ++x) {
            float s[3];
            shares(p, (float)x, (float)y, s);
            if (s[0] < -1e-5f || s[1] < -1e-5f || s[2] < -1e-5f) continue;
            float z = 1.0f / (s[0] * p.w[0] + s[1] * p.w[1] + s[2] * p.w[2]);
            if (!(z > 0)) continue;
            KEEP_NEAREST(patch + y * size + x, ((unsigned long long)DEPTH_BITS(z) << 32) | (unsigned)f);
        }
}

__device__ inline void texel(const unsigned char* picture, int height, int width, bool repeats, int y, int x,
                             float share, float* rgb) {
    if (repeats) {
        x = ((x % width) + width) % width;
        y = ((y % height) + height) % height;
    } else {
        x = x < 0 ? 0 : (x >= width ? width - 1 : x);
        y = y < 0 ? 0 : (y >= height ? height - 1 : y);
    }
    const unsigned char* at = picture + 3 * ((long long)y * width + x);
    for (int k = 0; k < 3; ++k) rgb[k] += share * at[k];
}

KERNEL resolve(const float* corners, const float* values, const long long* places, const int* meta,
               const float* measures, const int* levels, const unsigned char* texels, const long long* mesh,
               const float* pose, const float* camera, const unsigned long long* nearest, float* albedo,
               float* normal, float* depth, int size) {
    int pixel = blockIdx.x * blockDim.x + threadIdx.x, b = blockIdx.y;
    int area = size * size;
    if (pixel >= area) return;
    unsigned long long key = nearest[(long long)b * area + pixel];
    if (key == ~0ull) return;  // outputs are zero already
    long long slot = mesh[b];
    long long face = places[2 * slot] + (unsigned)(key & 0xffffffffu);
    const float* turn = pose + 12 * b;
    const float* lens = camera + 4 * b;
    Projected p;
    if (!project(corners + face * 9, turn, lens, &p)) return;
    float x = (float)(pixel % size), y = (float)(pixel / size), s[3], value[6] = {0, 0, 0, 0, 0, 0};
    shares(p, x, y, s);
    float z = BITS_DEPTH((unsigned)(key >> 32));
    for (int k = 0; k < 3; ++k) {
        float share = s[k] * p.w[k] * z;  // correct in perspective
        for (int c = 0; c < 6; ++c) value[c] += share * values[face * 18 + 6 * k + c];
    }
    // The face's own normal decides from which side it is seen.
    const float* corner = corners + face * 9;
    float e[3], g[3], cross[3], n[3], ray[3] = {(x - lens[2]) / lens[0], (y - lens[3]) / lens[1], 1.0f};
    for (int c = 0; c < 3; ++c) { e[c] = corner[3 + c] - corner[c]; g[c] = corner[6 + c] - corner[c]; }
    cross[0] = e[1] * g[2] - e[2] * g[1]; cross[1] = e[2] * g[0] - e[0] * g[2]; cross[2] = e[0] * g[1] - e[1] * g[0];
    float away = 0, excess = 0, ray2 = 0, length = 0;
    for (int r = 0; r < 3; ++r) {
        away += (turn[3 * r] * cross[0] + turn[3 * r + 1] * cross[1] + turn[3 * r + 2] * cross[2]) * ray[r];
        n[r] = turn[3 * r] * value[0] + turn[3 * r + 1] * value[1] + turn[3 * r + 2] * value[2];
        ray2 += ray[r] * ray[r];
    }
    for (int r = 0; r < 3; ++r) { if (away > 0) n[r] = -n[r]; excess += n[r] * ray[r]; }
    if (excess > 0) for (int r = 0; r < 3; ++r) n[r] -= 1.001f * excess / ray2 * ray[r];
    for (int r = 0; r < 3; ++r) length += n[r] * n[r];
    length = sqrtf(length) > 1e-12f ? sqrtf(length) : 1e-12f;
    float rgb[3] = {0, 0, 0};
    const int* about = meta + 4 * slot;
    if (about[1] > 0) {
        float near = turn[11] > measures[2 * slot + 1] ? turn[11] : measures[2 * slot + 1];
        float ratio = measures[2 * slot] * near / sqrtf(lens[0] * lens[1]);
        int level = (int)floorf(log2f(ratio > 1e-9f ? ratio : 1e-9f) + 0.5f);
        level = level < 0 ? 0 : (level >= about[1] ? about[1] - 1 : level);
        const int* one = levels + (slot * 12 + level) * 3;
        int height = one[1], width = one[2];
        bool repeats = about[2] > 0;
        const unsigned char* picture = texels + 3 * (places[2 * slot + 1] + one[0]);
        float u = value[3], v = value[4];
        if (repeats) { u -= floorf(u); v -= floorf(v); }
        float tx = u * width - 0.5f, ty = (1 - v) * height - 0.5f;
        float fx = floorf(tx), fy = floorf(ty), dx = tx - fx, dy = ty - fy;
        int ix = (int)fx, iy = (int)fy;
        texel(picture, height, width, repeats, iy, ix, (1 - dx) * (1 - dy), rgb);
        texel(picture, height, width, repeats, iy, ix + 1, dx * (1 - dy), rgb);
        texel(picture, height, width, repeats, iy + 1, ix, (1 - dx) * dy, rgb);
        texel(picture, height, width, repeats, iy + 1, ix + 1, dx * dy, rgb);
    } else {
        for (int k = 0; k < 3; ++k) rgb[k] = value[3 + k];
    }
    for (int k = 0; k < 3; ++k) {
        albedo[((long long)b * 3 + k) * area + pixel] = rgb[k] / 255.0f;
        normal[((long long)b * 3 + k) * area + pixel] = n[k] / length;
    }
    depth[(long long)b * area + pixel] = z;
}

#ifndef __CUDACC__
extern "C" void run(const float* corners, const float* values, const long long* places, const int* meta,
                    const float* measures, const int* levels, const unsigned char* texels,
                    const long long* mesh, const float* pose, const float* camera,
                    unsigned long long* nearest, float* albedo, float* normal, float* depth, int size,
                    int batch) {
    blockDim.x = 1; threadIdx.x = 0;
    for (blockIdx.y = 0; blockIdx.y < batch; ++blockIdx.y) {
        int faces = meta[4 * mesh[blockIdx.y]];
        for (blockIdx.x = 0; blockIdx.x < faces; ++blockIdx.x)
            rasterize(corners, places, meta, mesh, pose, camera, nearest, size);
        for (blockIdx.x = 0; blockIdx.x < size * size; ++blockIdx.x)
            resolve(corners, values, places, meta, measures, levels, texels, mesh, pose, camera, nearest, albedo,
                    normal, depth, size);
    }
}
#endif
