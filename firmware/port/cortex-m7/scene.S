/* The scene image in flash, beside the code. SCENE_FILE is given by the build. */
    .section .scene, "a", %progbits
    .balign 64
    .incbin SCENE_FILE
