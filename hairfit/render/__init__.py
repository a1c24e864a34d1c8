"""How hair looks: cameras, shading and rasters [Kim02, chapters 5 and 6]."""

from .camera import Camera as Camera
from .raster import Hits as Hits
from .raster import Raster as Raster
from .raster import mesh_depth as mesh_depth
from .raster import mesh_hits as mesh_hits
from .raster import project_points as project_points
from .raster import rasterise as rasterise
from .raster import vertex_normals as vertex_normals
from .raster import visible_points as visible_points
from .shading import Fibre as Fibre
from .shading import kajiya_kay as kajiya_kay
