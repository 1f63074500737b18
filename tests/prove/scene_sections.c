/* Proof    a section that is taken lies in its image, whole and aligned, whatever the table says of it
 * Entry    find_section of cr_scene_open
 * Bounds   none: every image of 288 bytes to 4 GiB, every count, offset and stride
 * Unwind   2 */
#include "prove.h"

#include "contact/scene.c"

void cr_sum_cluster(const struct cr_img_cluster *c, const float share[CR_LANES], struct cr_img_sum *out) {
    (void)c, (void)share, (void)out;
}

int cr_in_range(float v, float low, float high) { return v >= low && v <= high; }

int main(void) {
    const uint32_t size = nondet_u32(), id = nondet_u32(), stride = nondet_u32();
    ASSUME(size >= sizeof(struct cr_img_header) + CR_SEC_COUNT * sizeof(struct cr_img_section));
    ASSUME(id >= 1u && id <= CR_SEC_COUNT);
    const uint8_t *image = any_bytes(size);
    const struct cr_img_section *table = (const struct cr_img_section *)(image + sizeof(struct cr_img_header));
    const struct cr_img_section *said =
        &table[id - 1u]; /* as find_section writes it: the solver sees that it is the same */
    uint32_t count = 0u;
    const uint8_t *section = find_section(image, size, id, stride, &count);
    if (section != NULL) {
        PROVE(said->stride == stride && said->count == count);
        PROVE(section == image + said->offset && said->offset % CR_IMG_ALIGN == 0u);
        PROVE(said->offset <= size && (uint64_t)said->count * said->stride <= size - said->offset);
    }
    return 0;
}
