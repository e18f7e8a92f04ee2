"""Part mesh to facets to contacts to grasps; knows hands, knows no robot."""
