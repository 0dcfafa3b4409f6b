"""blender -b --factory-startup -P blender_render.py -- WIDTH HEIGHT EX EY EZ TX TY TZ UX UY UZ FOV FILE.glb OUT.png ...

Imports each GLB as it is, renders it with Cycles on the processor from the camera (glTF's axes, fov: vertical, degrees)
and writes what a screen shows: sRGB without any view transformation.
"""
import math
import sys

import bpy
from mathutils import Matrix, Vector


def point(x, y, z):
    return Vector((x, -z, y))  # glTF's y is up, Blender's z


def place_camera(eye, target, up, fov):
    back = (eye - target).normalized()
    right = up.cross(back).normalized()
    rotation = Matrix((right, back.cross(right), back)).transposed()
    data = bpy.data.cameras.new("camera")
    data.sensor_fit = "VERTICAL"
    data.angle = math.radians(fov)
    distance = (eye - target).length
    data.clip_start, data.clip_end = distance / 1000, distance * 1000
    camera = bpy.data.objects.new("camera", data)
    camera.matrix_world = Matrix.Translation(eye) @ rotation.to_4x4()
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera


def settings(width, height):
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = 16
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.use_denoising = False
    scene.cycles.max_bounces = 0
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage = 100
    scene.render.filter_size = 0.01  # a pixel is the mean over its own square
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.dither_intensity = 0
    scene.view_settings.view_transform = "Standard"
    scene.world = None


def main():
    arguments = sys.argv[sys.argv.index("--") + 1:]
    width, height = map(int, arguments[:2])
    numbers = list(map(float, arguments[2:12]))
    files = arguments[12:]
    for source, picture in zip(files[::2], files[1::2]):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        # Debian 12's importer (3.4.1) asks numpy 1.24 for what it has no more, but for this setting.
        bpy.ops.import_scene.gltf(filepath=source, import_shading="SMOOTH")
        for mesh in bpy.data.meshes:
            print("imported", mesh.name, len(mesh.vertices), "vertices, uv sets", len(mesh.uv_layers))
        settings(width, height)
        place_camera(point(*numbers[0:3]), point(*numbers[3:6]), point(*numbers[6:9]), numbers[9])
        bpy.context.scene.render.filepath = picture
        bpy.ops.render.render(write_still=True)


try:
    main()
except Exception as error:  # blender itself would end with status 0
    print("blender_render: error:", error, file=sys.stderr)
    sys.exit(1)
