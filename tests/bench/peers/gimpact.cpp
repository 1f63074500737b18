/* Bullet's GImpact, triangle mesh against triangle mesh, in double precision (peers.h).
 *
 * All contacts of a pair are taken, not the four that a persistent manifold keeps. Margin 0: the default of 40 mm would be felt. */
#include "peers.h"

#include <BulletCollision/Gimpact/btGImpactCollisionAlgorithm.h>
#include <BulletCollision/Gimpact/btGImpactShape.h>
#include <algorithm>
#include <btBulletCollisionCommon.h>

namespace {

/* Gathers what the algorithm finds. The normal on B points from B to A: out of the static object, which is asked for as B. */
class Gather : public btManifoldResult {
  public:
    using btManifoldResult::btManifoldResult;

    void addContactPoint(const btVector3 &normal, const btVector3 &, btScalar distance) override {
        peers_add(&found, normal.m_floats, std::max(0.0, -distance));
    }

    peers_contacts found{};
};

/* A mesh as a collision object. The members stay where they are: the shape points into the vertices of peers_mesh. */
struct Body {
    explicit Body(const peers_mesh *m)
        : triangles(m->triangle_count, const_cast<int *>(m->triangles), 3 * sizeof(int), m->vertex_count,
                    const_cast<btScalar *>(m->vertices), 3 * sizeof(btScalar)),
          shape(&triangles) {
        shape.setMargin(0);
        shape.updateBound();
        object.setCollisionShape(&shape);
    }

    btTriangleIndexVertexArray triangles;
    btGImpactMeshShape shape;
    btCollisionObject object;
};

} // namespace

void peers_gimpact(const peers_mesh *fixed, const peers_mesh *tool, const double *poses, int count, int repeat,
                   double *out) {
    btDefaultCollisionConfiguration configuration;
    btCollisionDispatcher dispatcher(&configuration);
    btGImpactCollisionAlgorithm::registerAlgorithm(&dispatcher);
    const btDispatcherInfo info;
    Body a(fixed), b(tool);
    for (int i = 0; i < count; i++) {
        const double *p = poses + 7 * i;
        const btTransform at(btQuaternion(p[4], p[5], p[6], p[3]), btVector3(p[0], p[1], p[2]));
        const btCollisionObjectWrapper still(nullptr, &a.shape, &a.object, a.object.getWorldTransform(), -1, -1);
        const btCollisionObjectWrapper moved(nullptr, &b.shape, &b.object, at, -1, -1);
        b.object.setWorldTransform(at);
        btCollisionAlgorithm *algorithm =
            dispatcher.findAlgorithm(&moved, &still, nullptr, BT_CONTACT_POINT_ALGORITHMS);
        double least_us = 1e30;
        peers_contacts found{};
        for (int r = 0; r < repeat; r++) {
            Gather gather(&moved, &still);
            const double start_us = peers_now_us();
            algorithm->processCollision(&moved, &still, info, &gather);
            least_us = std::min(least_us, peers_now_us() - start_us);
            found = gather.found;
        }
        peers_answer(&found, least_us, out + PEERS_ANSWER * i);
        algorithm->~btCollisionAlgorithm();
        dispatcher.freeCollisionAlgorithm(algorithm);
    }
}
