def build(folder, quick=False, progress=print): return folder
